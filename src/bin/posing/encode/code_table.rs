//! The table of sparse codes that `encode` writes: `atom1,coef1,…,atomK,coefK,rms`.

use ndarray::Array2;
use posing::cli::input::RowStream;
use posing::cli::messages;
use posing::io::text::{push_f32, push_f64, push_integer};
use posing::io::{Output, Row};
use posing::numeric::parallel;
use posing::sparse::{Encoder, SparseCodes};
use posing::{Error, Result};
use std::ops::Range;

/// Poses that all threads encode together, while the next are read: enough for the first batch to
/// build the search index.
const BATCH: usize = 1 << 10;
/// Lines that one thread writes at a time.
const LINES: usize = 256;

/// Encodes the poses of a stream with at most `sparsity` atoms each, and writes the header and a
/// line per pose.
///
/// # Errors
/// When a pose cannot be read or encoded, or a line cannot be written; all lines before it are
/// written.
pub fn write(
    stream: RowStream<'_>,
    encoder: &Encoder,
    sparsity: usize,
    output: &mut Output,
) -> Result<()> {
    let header: Vec<String> = (1..=sparsity).map(|k| format!("atom{k},coef{k}")).collect();
    output.write(format!("{},rms\n", header.join(",")).as_bytes())?;
    let mut batches = PoseBatches {
        stream,
        pending_error: None,
    };
    if let Some(poses) = batches.next()? {
        messages::debug(&format!("search: {}", encoder.strategy(poses.nrows())));
        // By itself: the first batch builds the search index for the others.
        output.write(&encoded_lines(encoder, sparsity, &poses)?)?;
    }
    parallel::ordered_pipeline(
        2,
        || batches.next(),
        |poses| encoded_lines(encoder, sparsity, &poses),
        |lines| output.write(&lines),
    )
}

/// The poses of a stream in batches.
struct PoseBatches<'a> {
    stream: RowStream<'a>,
    /// An error of reading that is returned after the poses before it.
    pending_error: Option<Error>,
}

impl PoseBatches<'_> {
    /// Up to [`BATCH`] poses (poses, coordinates); none at the end.
    fn next(&mut self) -> Result<Option<Array2<f32>>> {
        if let Some(error) = self.pending_error.take() {
            return Err(error);
        }
        let width = self.stream.columns().width();
        let mut values = Vec::with_capacity(BATCH * width);
        let mut row = Row::default();
        while values.len() < BATCH * width {
            match self.stream.read(&mut row) {
                Ok(true) => values.extend(row.xyz.iter().map(|v| *v as f32)),
                Ok(false) => break,
                Err(error) if values.is_empty() => return Err(error),
                Err(error) => {
                    self.pending_error = Some(error);
                    break;
                }
            }
        }
        let shape = (values.len() / width.max(1), width);
        let poses = Array2::from_shape_vec(shape, values).unwrap_or_default();
        Ok((poses.nrows() > 0).then_some(poses))
    }
}

/// The codes of some poses as text; missing coordinates (NaN) have weight 0.
fn encoded_lines(encoder: &Encoder, sparsity: usize, poses: &Array2<f32>) -> Result<Vec<u8>> {
    // A fold without an early exit compares several numbers at once.
    let has_missing = poses.fold(false, |any, v| any | !v.is_finite());
    let observed = has_missing.then(|| poses.mapv(|v| f32::from(v.is_finite())));
    let codes = encoder.encode_weighted(poses.view(), observed.as_ref().map(|o| o.view()))?;
    let count = |pose: usize| match &observed {
        Some(observed) => observed.row(pose).sum(),
        None => poses.ncols() as f32,
    };
    let lines = |rows: Range<usize>| {
        let mut out = Vec::with_capacity(64 * rows.len());
        for pose in rows {
            // NaN, written as an empty cell, where nothing is observed.
            let mean_square = codes.squared_residuals[pose] / f64::from(count(pose));
            push_line(&mut out, sparsity, &codes, pose, mean_square.sqrt());
        }
        out
    };
    Ok(parallel::map_chunks(codes.len(), LINES, lines).concat())
}

fn push_line(out: &mut Vec<u8>, sparsity: usize, codes: &SparseCodes, pose: usize, rms: f64) {
    let mut used = 0;
    for (atom, coefficient) in codes.entries(pose) {
        push_integer(out, atom);
        out.push(b',');
        push_f32(out, coefficient);
        out.push(b',');
        used += 1;
    }
    out.extend(std::iter::repeat_n(b',', 2 * (sparsity - used)));
    push_f64(out, rms);
    out.push(b'\n');
}
