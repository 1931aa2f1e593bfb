//! For testing engines: samples, comparisons, and the checks that every engine must pass.

pub mod authors;
pub mod compare;
pub mod conformance;
pub mod directed;
pub mod instances;
pub mod oracle;
pub mod rays;
pub mod sample;
pub mod speed;
