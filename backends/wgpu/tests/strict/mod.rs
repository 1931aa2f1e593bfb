//! Messages of the Vulkan validation layer, which wgpu logs, end the test.

use std::sync::Once;

use log::{Level, LevelFilter, Log, Metadata, Record};

struct Strict;

/// Where wgpu logs what layers say.
const LAYERS: &str = "wgpu_hal::vulkan::instance";

/// Layers before 1.3.250 do not know WGSL as the language of a shader's source.
const OLD_LAYER: &str = "Invalid source language operand";

impl Log for Strict {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.level() <= Level::Warn && metadata.target() == LAYERS
    }

    fn log(&self, record: &Record<'_>) {
        let text = record.args().to_string();
        // Details of a message come as records of their own, which begin with a tab.
        if self.enabled(record.metadata()) && !text.starts_with('\t') && !text.contains(OLD_LAYER) {
            eprintln!("{text}");
            // wgpu calls from a callback that catches panics.
            std::process::abort();
        }
    }

    fn flush(&self) {}
}

/// From now on, a message of the layer ends the process. wgpu loads the layer, where it is installed, in programs with debug
/// assertions.
pub(crate) fn listen() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        log::set_logger(&Strict).expect("no test has another logger");
        log::set_max_level(LevelFilter::Warn);
    });
}
