//! The commands: options and code of each. [`crate::args`] lists them.

pub(crate) mod advise;
pub(crate) mod ambient;
pub(crate) mod bench;
pub(crate) mod build;
pub(crate) mod completions;
pub(crate) mod convert;
pub(crate) mod diff;
pub(crate) mod dump;
pub(crate) mod export;
pub(crate) mod hits;
pub(crate) mod info;
mod info_served;
pub(crate) mod join;
pub(crate) mod kernel;
pub(crate) mod man;
pub(crate) mod plan;
pub(crate) mod rays;
pub(crate) mod render;
pub(crate) mod validate;
pub(crate) mod view;
