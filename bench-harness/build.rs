//! Hands the compiler's version to the program, so that reports can name it.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-env-changed=RUSTC");
    let rustc = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".into());
    if let Ok(out) = std::process::Command::new(rustc).arg("--version").output() {
        println!("cargo::rustc-env=ESVO_RUSTC_VERSION={}", String::from_utf8_lossy(&out.stdout).trim());
    }
}
