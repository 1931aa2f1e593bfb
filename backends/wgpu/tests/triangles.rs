//! Triangles: the hits of the exact caster, on whatever device there is.

mod strict;

use esvo_wgpu::WgpuTriangles;

esvo_cpu::triangle_suite!(|options| {
    strict::listen();
    Ok(Box::new(WgpuTriangles::new(options)?))
});
