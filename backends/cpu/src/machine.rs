//! The name of the processor.

/// Model name of the processor as `/proc/cpuinfo` has it, or its architecture where there is none. The only place that reads
/// it: the records of benchmarks take the name from here.
pub fn cpu_name() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = info.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
    model.map_or_else(|| std::env::consts::ARCH.to_owned(), |(_, name)| name.trim().to_owned())
}
