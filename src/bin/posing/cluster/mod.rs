//! Groups poses by hierarchical k-means.

mod split;

use self::split::{KMeansArgs, SplitFolder};
use clap::Parser;
use posing::cli::args::{OutputArgs, SeedArgs, TableArgs};
use posing::cli::paths::OutputPath;
use posing::cli::progress::Progress;
use posing::cli::streams;
use posing::cli::{input, messages};
use posing::cluster::KMeansProgress;
use posing::io::Model;
use posing::io::csv::{AddedColumn, After};
use posing::io::model::check_point_count;
use posing::pose::units::Units;
use posing::prior::provenance::{digest, entry};
use posing::{Error, Place, Result};

/// Group poses by hierarchical k-means
///
/// Adds the column cluster, counted from 0; with --split, writes one table per cluster. The
/// distance is Euclidean over all coordinates. Rows are used as they are: to ignore position and
/// heading, convert with amc2xyz --space body. Missing values are an error.
#[derive(Parser)]
#[command(
    name = "cluster",
    version,
    after_help = "Examples:\
        \n  posing cluster -k 8 poses.csv > grouped.csv\
        \n  posing cluster -k 8 --balance --split parts poses.csv\
        \n  posing cluster -k 2000 --branch 10 --save centroids.npz -o grouped.csv poses.npy"
)]
pub struct Args {
    #[command(flatten)]
    tables: TableArgs,
    #[command(flatten)]
    kmeans: KMeansArgs,
    /// Write the centroids to a model file
    #[arg(long, value_name = "CENTROIDS.npz")]
    save: Option<OutputPath>,
    /// Write one table per cluster into DIR: 0.csv, 1.csv, …
    #[arg(long, value_name = "DIR", conflicts_with = "output")]
    split: Option<OutputPath>,
    #[command(flatten)]
    seed: SeedArgs,
    #[command(flatten)]
    out: OutputArgs,
}

pub fn work(args: &Args) -> Result<()> {
    let split = args.split.as_deref().map(|folder| SplitFolder {
        folder,
        parts: args.kmeans.k as usize,
        out: &args.out,
    });
    match &split {
        Some(split) => split.check()?,
        None => args.out.format().check_added(&added())?,
    }
    let table = input::read_table(&args.tables.input(), false, true)?;
    if args.save.is_some() {
        check_point_count(table.columns.points.len(), &table.name)?;
    }
    let poses = table.poses.xyz.mapv(|v| v as f32);
    let mut rows = poses.rows().into_iter();
    if let Some(bad) = rows.position(|row| row.iter().any(|v| v.is_nan())) {
        let what = format!(
            "frame {} has missing values; fill them first with posing complete",
            bad + 1
        );
        return Err(Error::data(Place::file(&table.name), what));
    }
    let kmeans = args.kmeans.kmeans(args.seed.seed);
    let bar = Progress::new("cluster", u64::from(args.kmeans.k));
    let clustering = kmeans.fit_with_progress(poses.view(), &mut |update| match update {
        KMeansProgress::Seeds { seeds, .. } => bar.set(*seeds as u64),
        KMeansProgress::Split { leaves } => bar.set(*leaves as u64),
        _ => {}
    })?;
    drop(bar);
    let rms = (clustering.inertia / poses.len().max(1) as f64).sqrt();
    messages::debug(&format!(
        "{} iterations, RMS {rms:.4} cm per coordinate",
        clustering.iterations
    ));
    if !clustering.converged {
        messages::info("stopped before k-means converged");
    }
    if let Some(path) = &args.save {
        let points = &table.columns.points;
        let mut model = Model::new("centroids", points, "body");
        model.insert("centroids", clustering.centroids.mapv(|v| v as f32));
        let flags = args.kmeans.history(args.seed.seed);
        let inputs = vec![digest(points, poses.view())];
        model.meta.history.push(entry("cluster", &flags, inputs));
        streams::write_bytes(Some(path), &model.to_bytes()?, true)?;
    }
    match &split {
        Some(split) => split.write(&table, &clustering.labels)?,
        None => {
            let label = |t: usize| vec![clustering.labels[t].to_string()];
            streams::write_table(
                &args.out,
                [Units::CM_Y; 2],
                &table,
                table.poses.xyz.view(),
                &added(),
                label,
            )?;
        }
    }
    Ok(())
}

/// The column that the table gets.
fn added() -> [AddedColumn; 1] {
    [AddedColumn::new("cluster", After::All)]
}
