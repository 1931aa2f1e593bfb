//! Checks of the rules of the specification.

pub(crate) mod metadata;
pub(crate) mod report;
pub(crate) mod stored;
pub(crate) mod tables;
pub(crate) mod topology;
pub(crate) mod validate;
mod validate_components;
mod validate_values;
