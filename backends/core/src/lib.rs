//! Rays, cameras, the Caster trait, the reference caster and the kernel sources of esvo.
