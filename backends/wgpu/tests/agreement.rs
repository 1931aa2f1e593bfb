//! The kernel against the reference caster, on whatever device there is.

mod strict;

use esvo_core::testing::conformance::Subject;
use esvo_wgpu::WgpuCaster;

const ENGINE: Subject = Subject::kernel(|options| {
    strict::listen();
    Ok(Box::new(WgpuCaster::new(options)?))
});

esvo_core::kernel_suite!(wgpu, super::super::ENGINE);
