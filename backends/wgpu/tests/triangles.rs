//! Triangles: the hits of the exact caster, on whatever device there is.

use esvo_wgpu::WgpuTriangles;

esvo_cpu::triangle_suite!(|options| Ok(Box::new(WgpuTriangles::new(options)?)));
