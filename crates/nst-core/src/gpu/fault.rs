//! Faults on demand: which one the environment variable `NST_FAULT` asks for. Tests of
//! what a program does then have them; without the feature `fault-injection` there are none.

/// What is to fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(not(feature = "fault-injection"), allow(dead_code, reason = "nothing fails"))]
pub(super) enum Fault {
    /// Nothing; but software adapters pass for hardware, as with all faults.
    None,
    /// The adapter does not open.
    Open,
    /// Its limits are too low.
    Limits,
    /// The shader does not compile.
    Shader,
    /// There is no memory for the buffers.
    Memory,
    /// The device is lost after the first submission.
    Lost,
    /// The driver panics.
    Panic,
}

#[cfg(feature = "fault-injection")]
pub(super) fn wanted() -> Option<Fault> {
    let name = std::env::var("NST_FAULT").ok()?;
    Some(match name.as_str() {
        "none" => Fault::None,
        "open" => Fault::Open,
        "limits" => Fault::Limits,
        "shader" => Fault::Shader,
        "memory" => Fault::Memory,
        "lost" => Fault::Lost,
        "panic" => Fault::Panic,
        _ => panic!("NST_FAULT={name}: no such fault"),
    })
}

#[cfg(not(feature = "fault-injection"))]
pub(super) fn wanted() -> Option<Fault> {
    None
}
