//! Transitions between the takes of a table: which pairs of takes, their candidate frames, whether
//! these are good, the table of them, and the blended take.

use super::take_pairs::{check_rates, take_pairs};
use ndarray::Array2;
use posing::cli::args::OutputArgs;
use posing::cli::metric_takes::MetricTakes;
use posing::cli::{messages, streams};
use posing::io::Table;
use posing::io::text::{excerpt, push_f32};
use posing::metric::transition::candidates;
use posing::metric::{
    Blend, BlendQuality, Blender, Candidate, Clip, ClipRange, FrameRef, PoseMetric,
    TransitionSearch,
};
use posing::numeric::parallel;
use posing::pose::units::Units;
use posing::{Error, Place, Result};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Seconds from frame to frame of transitions of a take into itself, at least.
const LEAST_JUMP: f64 = 1.0;

/// Seconds that each take shows all joints about a transition, at least.
const LEAST_ROOM: f64 = 0.3;

/// Which transitions are looked for.
#[derive(Debug, Clone)]
pub struct TransitionSettings {
    /// The take that is left; `None`: each.
    pub from: Option<String>,
    /// The take that is entered; `None`: each.
    pub to: Option<String>,
    /// Whether takes also go over into themselves.
    pub within: bool,
    /// The frames of the one transition that is wanted, if it is known.
    pub at: Option<[usize; 2]>,
    /// Transitions of a pair of takes, at most.
    pub most: usize,
    /// Whether only good ones count.
    pub is_good_only: bool,
    /// Seconds between two transitions of a pair of takes, in one of the takes at least.
    pub apart: f64,
    /// Seconds of the blend; `None`: as long as it is good.
    pub over: Option<f64>,
}

/// A candidate, and what its blend is like.
#[derive(Debug, Clone, Copy)]
pub struct Transition {
    /// The take that is left, and the one that is entered.
    pub takes: [usize; 2],
    /// The frames, and their distance.
    pub candidate: Candidate,
    /// The blend against its limits.
    pub quality: BlendQuality,
}

/// A take that is left or entered.
struct End {
    clip: Clip,
    range: ClipRange,
    /// Whether each frame can be the middle of a blend.
    can_fade: Vec<bool>,
    /// The vectors of the frames by the metric; NaN for those that cannot.
    vectors: Array2<f32>,
}

/// The transitions of a table's takes.
pub struct Transitions<'a> {
    takes: &'a MetricTakes,
    metric: &'a PoseMetric,
    settings: &'a TransitionSettings,
    pairs: Vec<[usize; 2]>,
    /// The takes of the pairs.
    ends: BTreeMap<usize, End>,
}

impl<'a> Transitions<'a> {
    /// Prepares the takes that the settings name.
    ///
    /// # Errors
    /// [`Error::Usage`]: there are no two takes, or takes of different rates. [`Error::Data`]: a
    /// take is not there, or no frame has
    /// room for a blend.
    pub fn new(
        takes: &'a MetricTakes,
        metric: &'a PoseMetric,
        settings: &'a TransitionSettings,
    ) -> Result<Transitions<'a>> {
        let [from, to] = [&settings.from, &settings.to].map(Option::as_deref);
        let pairs = take_pairs(takes, from, to, settings.within)?;
        if settings.at.is_some() && pairs.len() > 1 {
            return Err(Error::usage(
                "--at names frames of two takes; choose the takes with --from and --to",
            ));
        }
        check_rates(takes, &pairs)?;
        let used: BTreeSet<usize> = pairs.iter().flatten().copied().collect();
        let ends = (used.into_iter())
            .map(|take| Ok((take, End::new(takes, take, metric, settings)?)))
            .collect::<Result<_>>()?;
        let transitions = Transitions {
            takes,
            metric,
            settings,
            pairs,
            ends,
        };
        transitions.check_room()?;
        Ok(transitions)
    }

    /// Fails if no pair of takes has room for a blend; names the takes that have none.
    fn check_room(&self) -> Result<()> {
        let has_room = |take: &usize| self.ends[take].can_fade.contains(&true);
        let lacking: Vec<&usize> = self.ends.keys().filter(|k| !has_room(k)).collect();
        let Some(first) = lacking.first() else {
            return Ok(());
        };
        let what = format!(
            "take {} shows all joints nowhere for the {} s of a blend",
            excerpt(&self.takes.names[**first]),
            self.settings.over.unwrap_or(LEAST_ROOM)
        );
        if !self.pairs.iter().any(|pair| pair.iter().all(has_room)) {
            let what = format!("{what}; shorten it with --over, or fill gaps with complete");
            return Err(Error::data(Place::file(&self.takes.source), what));
        }
        let others = match lacking.len() - 1 {
            0 => String::new(),
            more => format!(", nor do {more} others"),
        };
        messages::info(&format!("{}: {what}{others}: left out", self.takes.source));
        Ok(())
    }

    /// The transitions of all pairs of takes, those of a pair nearest first; or the one that is
    /// wanted.
    ///
    /// # Errors
    /// [`Error::Usage`]: the frames that are wanted have no room for a blend.
    pub fn find(&self) -> Result<Vec<Transition>> {
        if let Some(frames) = self.settings.at {
            return Ok(vec![self.wanted(self.pairs[0], frames)?]);
        }
        let found = parallel::map_chunks(self.pairs.len(), 1, |pairs| {
            let found = pairs.map(|k| self.of_pair(self.pairs[k]));
            found.collect::<Vec<_>>().concat()
        });
        Ok(found.concat())
    }

    /// The transitions of a pair of takes.
    fn of_pair(&self, takes: [usize; 2]) -> Vec<Transition> {
        let [a, b] = takes.map(|take| &self.ends[&take]);
        let search = TransitionSearch {
            most: self.settings.most,
            apart: a.clip.frames_in(self.settings.apart),
            least_jump: if takes[0] == takes[1] {
                a.clip.frames_in(LEAST_JUMP)
            } else {
                0
            },
        };
        let blender = Blender::new([&a.clip, &b.clip]);
        let transition = |candidate: Candidate| self.transition(&blender, takes, candidate);
        let is_wanted = |candidate: &Candidate| {
            let found = transition(*candidate);
            found.is_some_and(|t| !self.settings.is_good_only || t.quality.is_good())
        };
        let vectors = [a.vectors.view(), b.vectors.view()];
        let found = candidates(vectors, self.metric.norm, &search, is_wanted);
        found.into_iter().filter_map(transition).collect()
    }

    /// The transition that is wanted.
    fn wanted(&self, takes: [usize; 2], frames: [usize; 2]) -> Result<Transition> {
        for (take, frame) in takes.into_iter().zip(frames) {
            let can_fade = self.ends[&take].can_fade.get(frame);
            if can_fade != Some(&true) {
                return Err(Error::usage(format!(
                    "--at: frame {frame} of take {} has no {} s before and after it that show all \
                     joints",
                    excerpt(&self.takes.names[take]),
                    self.settings.over.unwrap_or(LEAST_ROOM) / 2.0
                )));
            }
        }
        let [a, b] = [0, 1].map(|k| self.ends[&takes[k]].vectors.row(frames[k]));
        let distance = self.metric.norm.distance(a, b);
        let blender = Blender::new(takes.map(|take| &self.ends[&take].clip));
        let transition = self.transition(&blender, takes, Candidate { frames, distance });
        transition.ok_or_else(|| Error::usage("--at: the takes end too near to these frames"))
    }

    fn transition(
        &self,
        blender: &Blender<'_>,
        takes: [usize; 2],
        candidate: Candidate,
    ) -> Option<Transition> {
        let (_, quality) = self.blend(blender, takes, candidate.frames)?;
        Some(Transition {
            takes,
            candidate,
            quality,
        })
    }

    fn blend<'b>(
        &self,
        blender: &Blender<'b>,
        takes: [usize; 2],
        frames: [usize; 2],
    ) -> Option<(Blend<'b>, BlendQuality)> {
        let ranges = takes.map(|take| &self.ends[&take].range);
        blender.blend(frames, self.settings.over, ranges)
    }

    /// Writes `a_take,a_frame,b_take,b_frame,distance,bones,feet,acceleration,good`.
    ///
    /// # Errors
    /// When the output cannot be written.
    pub fn write(&self, output: Option<&Path>, found: &[Transition]) -> Result<()> {
        let mut out = streams::open_output(output, false)?;
        out.write(b"a_take,a_frame,b_take,b_frame,distance,bones,feet,acceleration,good\n")?;
        for transition in found {
            let mut line = Vec::new();
            for (take, frame) in transition
                .takes
                .into_iter()
                .zip(transition.candidate.frames)
            {
                self.takes.push_frame(&mut line, FrameRef { take, frame });
                line.push(b',');
            }
            // A metric's window may reach beyond the blend, to joints that are missing.
            if transition.candidate.distance.is_finite() {
                push_f32(&mut line, transition.candidate.distance);
            }
            let quality = transition.quality;
            for share in [quality.bones, quality.feet, quality.acceleration] {
                line.extend(format!(",{share:.3}").bytes());
            }
            line.extend(format!(",{}\n", u8::from(quality.is_good())).bytes());
            out.write(&line)?;
        }
        out.finish()
    }

    /// Writes the nearest good transition of `found` as one take, or the nearest if none is good.
    ///
    /// # Errors
    /// [`Error::Data`]: nothing was found. When the output cannot be written.
    pub fn write_blend(&self, found: &[Transition], path: &Path) -> Result<()> {
        let nearest = |is_good: bool| {
            let wanted = found.iter().filter(|t| t.quality.is_good() == is_good);
            wanted.min_by(|x, y| x.candidate.distance.total_cmp(&y.candidate.distance))
        };
        let none = || {
            let source = Place::file(&self.takes.source);
            Error::data(source, "has no transition to blend")
        };
        let chosen = nearest(true).or_else(|| nearest(false)).ok_or_else(none)?;
        let blender = Blender::new(chosen.takes.map(|take| &self.ends[&take].clip));
        let blend = self.blend(&blender, chosen.takes, chosen.candidate.frames);
        let (blend, _) = blend.ok_or_else(none)?;
        let [a, b] = chosen.takes.map(|take| excerpt(&self.takes.names[take]));
        let [i, j] = chosen.candidate.frames;
        let verdict = if chosen.quality.is_good() {
            ""
        } else {
            "; no transition is good, this is the nearest"
        };
        messages::info(&format!(
            "blended frame {i} of {a} with frame {j} of {b} over {:.2} s, {b} at {:.2} frames for \
             one of {a}{verdict}",
            blend.seconds(),
            blend.pace()
        ));
        let name = chosen.takes.map(|take| self.takes.names[take].as_str());
        let table = Table::from_poses(blend.to_poses(&name.join(">")));
        let output = OutputArgs {
            output: Some(path.to_path_buf().into()),
            to: None,
        };
        let xyz = table.poses.xyz.view();
        streams::write_table(&output, [Units::CM_Y; 2], &table, xyz, &[], |_| Vec::new())
    }
}

impl End {
    fn new(
        takes: &MetricTakes,
        take: usize,
        metric: &PoseMetric,
        settings: &TransitionSettings,
    ) -> Result<End> {
        let range = takes.poses.takes()[take].clone();
        // Rates were checked.
        let rate = takes.takes[take].rate.unwrap_or(0.0);
        let clip = Clip::new(takes.poses.slice(range), rate, &metric.map)
            .map_err(|e| e.at(Place::file(&takes.source)))?;
        let room = settings.over.unwrap_or(LEAST_ROOM);
        let can_fade = clip.can_fade(clip.frames_in(room / 2.0));
        let mut vectors = metric.embed(&takes.takes[take]);
        for (mut row, can) in vectors.rows_mut().into_iter().zip(&can_fade) {
            if !can {
                row.fill(f32::NAN);
            }
        }
        Ok(End {
            range: ClipRange::measure(&clip),
            clip,
            can_fade,
            vectors,
        })
    }
}
