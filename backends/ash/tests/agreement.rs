//! The kernel against the reference caster, on whatever device there is.

use esvo_ash::AshCaster;
use esvo_core::testing::conformance::Subject;

const ENGINE: Subject = Subject::kernel(|options| Ok(Box::new(AshCaster::new(options)?)));

esvo_core::kernel_suite!(ash, super::super::ENGINE);
