//! The page that plays a trial of a session: markers, joint centers, and a list of its events.

use super::trials::EVENT_HEAD;
use crate::Result;
use crate::angles::CENTERS;
use crate::draw::scene::{Figure, Table};
use crate::draw::take_page::TakePage;
use crate::markers::MARKERS;
use crate::pose::Poses;
use crate::session::SessionTrial;
use crate::side::Side;
use glam::DVec3;
use ndarray::Array2;

/// What is joined, on each side and between them.
const OF_A_SIDE: &str = "HJC-KJC KJC-AJC AJC-TOE AJC-HEE HEE-TOE SHO-ELB ELB-WRA WRA-FIN";
const BETWEEN: &str = "LHJC-RHJC LSHO-C7 RSHO-C7 C7-T10 LFHD-RFHD LBHD-RBHD LFHD-LBHD RFHD-RBHD";

impl SessionTrial {
    /// The frame at a time, counted from 0.
    pub(crate) fn frame_at(&self, time: f64) -> usize {
        let last = self.trial.markers.frames().saturating_sub(1);
        (self.trial.place(time).round().max(0.0) as usize).min(last)
    }

    /// A page that plays the trial, with its events; its table leads back to the page at the
    /// address `back`. `None` of a trial without frames.
    ///
    /// # Errors
    /// The page, as [`player::page`](posing_draw::player::page) makes it.
    pub fn player(&self, back: Option<&str>) -> Result<Option<String>> {
        let (poses, bones) = self.poses();
        let rate = self.trial.rate;
        let note = format!(
            "Markers, and the centers of hips, knees and ankles by Plug-in Gait (HJC, KJC, AJC). \
             Centimeters, y up. {} frames at {} frames a second, from frame {} of the file.",
            poses.frames(),
            super::tables::number(Some(rate)),
            self.trial.first_frame
        );
        let figures = vec![Figure::new(&self.name, poses.xyz.view())];
        TakePage {
            name: &self.name,
            note: &note,
            poses: &poses,
            rate: Some(rate),
            bones: &bones,
            markers: None,
            figures,
            table: self.event_table(back),
        }
        .html()
    }

    /// The events, each a row that leads to its frame.
    fn event_table(&self, back: Option<&str>) -> Option<Table> {
        let mut table = Table {
            caption: "Events: a row leads to its frame".into(),
            header: EVENT_HEAD.map(String::from).to_vec(),
            ..Table::default()
        };
        for event in &self.gait.events {
            let time = format!("{:.3}", event.time_s);
            let frame = self.frame_at(event.time_s);
            table.rows.push([&[time], &event.cells()[..]].concat());
            table.links.push(format!("#frame={frame}"));
        }
        if let Some(back) = back {
            let mut row = vec![String::new(); EVENT_HEAD.len()];
            row[0] = "Back to the session".into();
            table.rows.push(row);
            table.links.push(back.into());
        }
        (!table.rows.is_empty()).then_some(table)
    }

    /// Joint centers and markers in centimeters with y up, and what is joined.
    fn poses(&self) -> (Poses, Vec<(usize, usize)>) {
        let sided = |name: &str| Side::BOTH.map(|side| format!("{}{name}", side.letter()));
        let mut tracks: Vec<(String, &[DVec3])> = Vec::new();
        for name in CENTERS[..3].iter().flat_map(|name| sided(name)) {
            if let Some(track) = self.gait.curves.get(&name) {
                tracks.push((name, track));
            }
        }
        for name in MARKERS {
            tracks.extend(
                self.trial
                    .markers
                    .get(name)
                    .map(|track| (name.into(), track)),
            );
        }
        let frames = self.trial.markers.frames();
        let xyz = Array2::from_shape_fn((frames, 3 * tracks.len()), |(t, column)| {
            let at = tracks[column / 3].1[t] / 10.0;
            [at.x, at.z, -at.y][column % 3]
        });
        let points: Vec<String> = tracks.into_iter().map(|(name, _)| name).collect();
        let place = |name: &str| points.iter().position(|p| p == name);
        let bones = [("", BETWEEN), ("L", OF_A_SIDE), ("R", OF_A_SIDE)];
        let bones = bones.into_iter().flat_map(|(side, list)| {
            let pairs = list.split(' ').filter_map(|pair| pair.split_once('-'));
            let own = |name: &str| place(&format!("{side}{name}"));
            pairs
                .filter_map(|(a, b)| own(a).zip(own(b)))
                .collect::<Vec<_>>()
        });
        let bones = bones.collect();
        let time = Some((0..frames).map(|t| self.trial.time(t)).collect());
        let take = None;
        (
            Poses {
                points,
                xyz,
                time,
                take,
            },
            bones,
        )
    }
}
