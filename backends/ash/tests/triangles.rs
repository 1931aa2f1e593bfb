//! Triangles: the hits of the exact caster, on whatever device there is.

use esvo_ash::AshTriangles;

esvo_cpu::triangle_suite!(|options| Ok(Box::new(AshTriangles::new(options)?)));
