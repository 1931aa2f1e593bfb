//! The wgpu compute caster of esvo.
