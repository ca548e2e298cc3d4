//! Loading a scene within limits of memory and depth, and what may be wrong with its settings.

use crate::{Error, Result};
use ufbx::{AllocatorOpts, CoordinateAxes, ErrorType, FileFormat, InheritModeHandling};
use ufbx::{LoadOpts, SceneRoot, WarningType};

/// The most bytes that the scene of a small file may take, and again as many while it is loaded: it
/// may have been packed well. That of a larger one may take so many times its size; a key takes
/// some 48 bytes, and 6 to 12 in a binary file.
const MEMORY: std::ops::RangeInclusive<usize> = 256 << 20..=2 << 30;
const TIMES_TEXT: usize = 2;
const TIMES_BINARY: usize = 8;
/// Deeper hierarchies are no skeletons.
const DEPTH: u32 = 512;
/// Meters that a file's unit of length may have: less or more is a slip.
const UNITS: std::ops::RangeInclusive<f64> = 1e-6..=1e4;

/// The scene in centimeters, right-handed, y up, without meshes; and what was odd.
///
/// # Errors
/// [`Error::Unfit`]: it cannot be read; the message says why.
pub(crate) fn load(bytes: &[u8]) -> Result<(SceneRoot, Vec<String>)> {
    let scene = load_as(bytes, 0.01)?;
    let mut notes = Vec::new();
    let mut warnings = scene.metadata.warnings.iter();
    if warnings.any(|warning| warning.type_ == WarningType::TruncatedArray) {
        notes.push("a list of numbers in it ends early: some keys may be missing".to_string());
    }
    let unit = scene.settings.original_unit_meters;
    if UNITS.contains(&unit) {
        return Ok((scene, notes));
    }
    // Without a conversion, the file's numbers are centimeters.
    notes.push(format!(
        "its unit of length is {} centimeters; it is taken for 1",
        unit * 100.0
    ));
    Ok((load_as(bytes, 0.0)?, notes))
}

/// Scales that a joint does not hand on stand in nodes of their own, so that a joint's transform is
/// the product of its ancestors' and its own.
fn load_as(bytes: &[u8], target_unit_meters: f64) -> Result<SceneRoot> {
    let options = LoadOpts {
        temp_allocator: limited(bytes),
        result_allocator: limited(bytes),
        ignore_geometry: true,
        ignore_embedded: true,
        file_format: FileFormat::Fbx,
        node_depth_limit: DEPTH,
        inherit_mode_handling: InheritModeHandling::HelperNodes,
        target_axes: CoordinateAxes::right_handed_y_up(),
        target_unit_meters,
        ..LoadOpts::default()
    };
    ufbx::load_memory(bytes, options).map_err(|fault| reason(&fault))
}

fn limited(bytes: &[u8]) -> AllocatorOpts {
    let is_binary = bytes.starts_with(b"Kaydara");
    let times = if is_binary { TIMES_BINARY } else { TIMES_TEXT };
    AllocatorOpts {
        memory_limit: (times * bytes.len()).clamp(*MEMORY.start(), *MEMORY.end()),
        ..AllocatorOpts::default()
    }
}

/// Why a file cannot be read.
fn reason(fault: &ufbx::Error) -> Error {
    let what = match fault.type_ {
        ErrorType::OutOfMemory | ErrorType::MemoryLimit | ErrorType::AllocationLimit => {
            "is too large: reading it needs far more memory than its size"
        }
        ErrorType::NodeDepthLimit => "is damaged: its nodes are nested more than 512 deep",
        ErrorType::UnsupportedVersion => {
            "has a version of FBX that is not read; export it as FBX 2014 to 2020 (7.4, 7.7)"
        }
        ErrorType::EmptyFile => "is an empty FBX file",
        // What a damaged file comes to is found in many places.
        _ => "is an FBX file that ends early or is damaged",
    };
    what.into()
}
