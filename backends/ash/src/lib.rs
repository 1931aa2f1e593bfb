//! The ash (Vulkan) compute caster of esvo.
