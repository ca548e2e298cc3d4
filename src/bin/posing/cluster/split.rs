//! `cluster` around the library: its flags, and a folder with one table a cluster.

use posing::cli::args::OutputArgs;
use posing::cli::paths::check_written;
use posing::cli::streams::create_table;
use posing::cluster::KMeans;
use posing::io::{Row, Table, TableFormat};
use posing::pose::units::Units;
use posing::{Error, Place, Result};
use std::collections::HashSet;
use std::path::Path;

/// The flags of k-means.
#[derive(Debug, Clone, clap::Args)]
pub struct KMeansArgs {
    /// Number of clusters, at most the number of poses
    #[arg(short, long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..))]
    pub k: u32,
    /// Split clusters into B at a time, as a tree, 2 or more; much faster for large K
    #[arg(long, value_name = "B", value_parser = clap::value_parser!(u32).range(2..))]
    pub branch: Option<u32>,
    /// Make clusters of equal size (to within one pose), so that the parts of --split take about
    /// equally long to train
    #[arg(long, conflicts_with = "branch")]
    pub balance: bool,
    /// Number of runs from different starts; the best is kept
    #[arg(
        long,
        value_name = "R",
        default_value_t = 1,
        value_parser = clap::value_parser!(u32).range(1..)
    )]
    pub restarts: u32,
}

impl KMeansArgs {
    /// The parameters of k-means.
    pub fn kmeans(&self, seed: u64) -> KMeans {
        KMeans {
            k: self.k as usize,
            seed,
            restarts: self.restarts as usize,
            branch: self.branch.map(|b| b as usize),
            balance: self.balance,
            ..KMeans::default()
        }
    }

    /// The flags that change numbers, for a model's history.
    pub fn history(&self, seed: u64) -> Vec<(&'static str, String)> {
        let mut flags = vec![
            ("k", self.k.to_string()),
            ("seed", seed.to_string()),
            ("restarts", self.restarts.to_string()),
        ];
        flags.extend(self.branch.map(|b| ("branch", b.to_string())));
        flags.extend(self.balance.then(|| ("balance", "true".to_string())));
        flags
    }
}

/// A folder of parts, `0.csv` to `K-1.csv` or `.npy`; numbers are padded with zeros to one width.
pub struct SplitFolder<'a> {
    /// The folder.
    pub folder: &'a Path,
    /// The number of parts.
    pub parts: usize,
    /// The format of the parts.
    pub out: &'a OutputArgs,
}

impl SplitFolder<'_> {
    fn name(&self, part: usize) -> String {
        let width = (self.parts - 1).to_string().len();
        let extension = match self.out.format() {
            TableFormat::Csv => "csv",
            TableFormat::Npy => "npy",
            TableFormat::Npz => "npz",
        };
        format!("{part:0width$}.{extension}")
    }

    /// Fails if the folder has parts of another split, which would be mistaken for parts of this
    /// one.
    ///
    /// # Errors
    /// When there are such files, or the folder cannot be read.
    pub fn check(&self) -> Result<()> {
        let parts = (0..self.parts).map(|part| self.folder.join(self.name(part)));
        check_written(parts)?;
        if !self.folder.is_dir() {
            return Ok(());
        }
        let own: HashSet<String> = (0..self.parts).map(|part| self.name(part)).collect();
        let entries = std::fs::read_dir(self.folder).map_err(|e| Error::io(self.folder, e))?;
        for entry in entries.flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            let number = name.strip_suffix(".csv").or(name.strip_suffix(".npy"));
            let is_part =
                number.is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()));
            if is_part && !own.contains(&name) {
                return Err(Error::data(
                    Place::file(entry.path().display().to_string()),
                    "is from another split and would be mixed up with this one; move it, or \
                     choose another folder",
                ));
            }
        }
        Ok(())
    }

    /// Writes the frames with label i into part i, with all their columns. No part appears before
    /// all are written: parts of two splits are never mixed.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn write(&self, table: &Table, labels: &[u32]) -> Result<()> {
        std::fs::create_dir_all(self.folder).map_err(|e| Error::io(self.folder, e))?;
        let mut row = Row::default();
        let mut members = vec![Vec::new(); self.parts];
        for (frame, &label) in labels.iter().enumerate() {
            members[label as usize].push(frame);
        }
        for (part, members) in members.into_iter().enumerate() {
            let out = OutputArgs {
                output: Some(self.folder.join(self.name(part)).into()),
                ..self.out.clone()
            };
            let mut sink = create_table(&out, [Units::CM_Y; 2], &table.columns, &[])?;
            for frame in members {
                table.row_into(frame, &mut row);
                let xyz = row.xyz.clone();
                sink.write(&mut row, &xyz, &[])?;
            }
            sink.finish()?;
        }
        Ok(())
    }
}
