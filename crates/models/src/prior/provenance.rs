//! The history of a model: commands, flags, and digests of the inputs.

use crate::io::model::HistoryEntry;
use ndarray::ArrayView2;
use sha2::{Digest, Sha256};

/// The SHA-256 digest of poses (m, 3 J): of names and numbers, not of files.
pub fn digest(points: &[String], xyz: ArrayView2<'_, f32>) -> String {
    let mut hash = Sha256::new();
    hash.update(points.join(",").as_bytes());
    for v in xyz {
        hash.update(v.to_le_bytes());
    }
    hex(&hash.finalize())
}

/// Bytes as lower-case hexadecimal.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

/// An entry of a model's history.
pub fn entry(command: &str, flags: &[(&str, String)], inputs: Vec<String>) -> HistoryEntry {
    HistoryEntry {
        command: command.into(),
        version: env!("CARGO_PKG_VERSION").into(),
        flags: flags
            .iter()
            .map(|(k, v)| (k.to_string(), v.clone()))
            .collect(),
        inputs,
    }
}
