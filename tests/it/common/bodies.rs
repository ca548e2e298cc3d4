//! The shared meshes: 40 poses of one person and 40 people, one topology.

use glam::DVec3;
use std::io::Read;
use std::path::Path;

/// The shared meshes, centimeters.
#[allow(dead_code)] // Every user takes a part of it.
#[derive(Clone)]
pub struct Bodies {
    pub poses: Vec<Vec<DVec3>>,
    pub people: Vec<Vec<DVec3>>,
    pub faces: Vec<[usize; 3]>,
    pub parts: Vec<usize>,
}

/// The numbers of an array of the archive: little-endian integers of `size` bytes.
fn numbers(archive: &mut zip::ZipArchive<std::fs::File>, name: &str, size: usize) -> Vec<i64> {
    let mut bytes = Vec::new();
    let mut entry = archive.by_name(&format!("{name}.npy")).unwrap();
    entry.read_to_end(&mut bytes).unwrap();
    let head = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let number = |b: &[u8]| match *b {
        [a] => i64::from(a as i8),
        [a, b] => i64::from(i16::from_le_bytes([a, b])),
        _ => unreachable!("integers of one or two bytes"),
    };
    bytes[head..].chunks_exact(size).map(number).collect()
}

/// Reads the shared archive, whose coordinates are whole multiples of 50 micrometers.
pub fn read(path: &Path) -> Bodies {
    let mut archive = zip::ZipArchive::new(std::fs::File::open(path).unwrap()).unwrap();
    let faces = numbers(&mut archive, "faces", 2);
    let parts: Vec<usize> = (numbers(&mut archive, "part", 1).iter())
        .map(|p| *p as usize)
        .collect();
    let mut meshes = |name: &str| -> Vec<Vec<DVec3>> {
        let points: Vec<DVec3> = (numbers(&mut archive, name, 2).chunks_exact(3))
            .map(|c| 5e-3 * DVec3::new(c[0] as f64, c[1] as f64, c[2] as f64))
            .collect();
        points
            .chunks_exact(parts.len())
            .map(<[_]>::to_vec)
            .collect()
    };
    Bodies {
        poses: meshes("poses"),
        people: meshes("people"),
        faces: faces
            .chunks_exact(3)
            .map(|f| [f[0], f[1], f[2]].map(|v| v as usize))
            .collect(),
        parts,
    }
}

#[allow(dead_code)] // Every user takes a part.
/// The distance of each vertex, mm, after a shift that puts the means together.
pub fn errors(found: &[DVec3], truth: &[DVec3]) -> Vec<f64> {
    let n = truth.len() as f64;
    let shift = (truth.iter().sum::<DVec3>() - found.iter().sum::<DVec3>()) / n;
    (found.iter().zip(truth))
        .map(|(a, b)| 10.0 * (*a + shift - *b).length())
        .collect()
}

#[allow(dead_code)]
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}
