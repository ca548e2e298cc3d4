//! Frames, rate and speed of a file of rotations.

use super::Args;
use posing::cli::endings::{check_ending, ending_of};
use posing::cli::messages;
use posing::cli::streams::write_bytes;
use posing::io::motion_file::{LARGEST_MOTION_FILE, ReadOptions};
use posing::io::{Input, MotionFile, MotionFormat};
use posing::numeric::butterworth::LowPass;
use posing::pose::Retiming;
use posing::{Error, Place, Result};
use std::ops::Range;
use std::path::PathBuf;

/// Trims the file of an input, the only one of `files`.
pub fn trim(args: &Args, files: &[PathBuf], input: Input) -> Result<()> {
    let name = input.name.clone();
    if let [_, second, ..] = files {
        let second = second.display();
        let what = format!("{name} is a file of rotations: give it alone, without {second}");
        return Err(Error::usage(what));
    }
    let format = MotionFormat::of(input.first_bytes());
    let is_fbx = format == MotionFormat::Fbx;
    let takes = (!is_fbx && !args.take.is_empty()).then_some("--take");
    if let Some(flag) = takes.or(args.first_of_tables()) {
        let what = format!(
            "{name} is a file of rotations, and {flag} for tables: make one of it with {}2xyz",
            format.name().to_lowercase()
        );
        return Err(Error::usage(what));
    }
    if let [_, second, ..] = &args.take[..] {
        let what = format!("--take: an FBX file is trimmed take by take; leave {second} out");
        return Err(Error::usage(what));
    }
    check_ending(args.output.as_deref(), &ending_of(format))?;
    let options = ReadOptions {
        fps: args.input.fps,
        units: args.input.units,
        asf: args.asf.clone(),
        take: args.take.first().cloned(),
        skeleton: args.skeleton.clone(),
        keep_whole: args.keep_whole,
        ..args.input.axes.options()
    };
    let bytes = input.read_all(LARGEST_MOTION_FILE)?;
    let file = MotionFile::read(&files[0], bytes, &options)?;
    file.check_rate(args.input.fps)?;
    (file.notes.iter()).for_each(|note| messages::info(&format!("{name}: {note}")));
    let trimmed = trimmed(args, &file).map_err(|e| e.at(Place::file(&name)))?;
    write_bytes(args.output.as_deref(), &trimmed, false)
}

/// The bytes of the result.
fn trimmed(args: &Args, file: &MotionFile) -> Result<Vec<u8>> {
    let own = file.rate().unwrap_or(1.0);
    let rate = args.rate_is.unwrap_or(own);
    let times = file.poses().time.as_deref().unwrap_or_default();
    let times: Vec<f64> = times.iter().map(|t| t * own / rate).collect();
    let frames = chosen(&times, rate, args.from, args.last())?;
    let new = args.resample.unwrap_or(rate);
    let step = rate / new * args.speed.unwrap_or(1.0);
    let channels = file.motion().map_or(0, |motion| motion.ncols());
    if frames.len() as f64 / step * channels as f64 > MOST_VALUES {
        return Err("would have too many frames at that rate and speed".into());
    }
    if step > MOST_LEFT_OUT {
        return Err(format!("would keep fewer than one frame in {MOST_LEFT_OUT}").into());
    }
    let mut timing = Retiming::even(frames.len(), step);
    timing.low_pass = args.butterworth.map(|hz| low_pass(hz, rate)).transpose()?;
    if timing.is_identity(frames.len()) {
        return cut(args, file, frames);
    }
    if args.rate_is.is_some() {
        // An AMC file has no rate to correct.
        file.bytes_of_frames(0..0, args.rate_is)?;
    }
    let start = times[frames.start];
    file.bytes_at_times(frames, &timing, args.resample.or(args.rate_is), start)
}

/// The bytes of frames at their own times.
fn cut(args: &Args, file: &MotionFile, frames: Range<usize>) -> Result<Vec<u8>> {
    if args.from.is_none() && args.last().is_none() {
        return file.bytes_of_frames(frames, args.rate_is);
    }
    let (bytes, turned) = file.bytes_of_part(frames, args.rate_is)?;
    if turned > 0 {
        messages::info(&format!(
            "{turned} angles are written with whole turns more or less: none jumps by a turn"
        ));
    }
    Ok(bytes)
}

/// The most frames that one of the result may stand for.
const MOST_LEFT_OUT: f64 = 100.0;
/// More values are not resampled to: 1 GiB.
const MOST_VALUES: f64 = (1_u64 << 27) as f64;

fn low_pass(cutoff: f64, rate: f64) -> Result<LowPass> {
    LowPass::new(cutoff, rate).ok_or_else(|| {
        format!("has {rate} frames per second: --butterworth {cutoff} has to be below .4 of that")
            .into()
    })
}

/// The frames from the one nearest to the time `from` to the one nearest to `to`.
fn chosen(times: &[f64], rate: f64, from: Option<f64>, to: Option<f64>) -> Result<Range<usize>> {
    let (Some(first), Some(last)) = (times.first(), times.last()) else {
        return Err("has no frames".into());
    };
    let beyond = 0.5 / rate;
    let is_there = from.is_none_or(|from| from <= last + beyond)
        && to.is_none_or(|to| to >= first - beyond)
        && from.zip(to).is_none_or(|(from, to)| from <= to);
    if !is_there {
        return Err("has no frame that was asked for".into());
    }
    let nearest = |time: f64| {
        let frame = ((time - first) * rate).round().max(0.0) as usize;
        frame.min(times.len() - 1)
    };
    Ok(from.map_or(0, nearest)..to.map_or(times.len(), |to| nearest(to) + 1))
}
