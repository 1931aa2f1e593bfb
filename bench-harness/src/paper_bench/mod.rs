//! `esvo bench`: the paper's two tables, measured on this machine.

pub mod check;
mod levels;
pub mod matrix;
mod measure;
pub(crate) mod paper;
pub mod report;
pub mod run;
pub mod tables;
