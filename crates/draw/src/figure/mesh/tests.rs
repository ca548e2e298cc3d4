use super::outline::tests::loops;
use super::*;
use crate::figure::tests::well_formed;
use crate::mesh_scene::MeshFigure;
use crate::mesh_scene::tests::{cube, scene};
use ndarray::Array3;

fn row(frames: usize) -> Row {
    let still = |frame| Still {
        figure: 0,
        frame,
        caption: format!("frame {frame}"),
    };
    Row {
        name: String::new(),
        stills: (0..frames).map(still).collect(),
    }
}

/// The paths of an SVG that are areas.
fn paths(svg: &str) -> Vec<&str> {
    let areas = svg.split("<path fill=\"#").skip(1);
    let path = |area: &str| area.find(" d=\"").map(|at| at + 4);
    areas
        .map(|a| {
            let rest = &a[path(a).unwrap()..];
            &rest[..rest.find('"').unwrap()]
        })
        .collect()
}

fn level() -> Options {
    Options {
        elevation: 0.0,
        ..Options::default()
    }
}

#[test]
fn a_cube_shows_the_faces_that_are_toward_the_viewer() {
    let (vertices, faces) = cube();
    let scene = scene(&vertices, &faces);
    // From the front one square, seen over a corner three.
    for (azimuth, elevation, count) in [(0.0, 0.0, 1), (90.0, 0.0, 1), (30.0, 25.0, 3)] {
        let options = Options {
            azimuth: Some(azimuth),
            elevation,
            ..Options::default()
        };
        let drawn = svg(&scene, &[row(1)], &options).unwrap();
        well_formed(&drawn);
        let loops: Vec<_> = paths(&drawn).iter().flat_map(|p| loops(p)).collect();
        assert_eq!(loops.len(), count, "{drawn}");
        assert!(loops.iter().all(|l| l.len() == 4));
    }
}

#[test]
fn the_side_toward_the_light_is_lighter() {
    let (vertices, faces) = cube();
    let scene = scene(&vertices, &faces);
    let options = Options {
        azimuth: Some(0.0),
        elevation: 45.0,
        ..Options::default()
    };
    let drawn = svg(&scene, &[row(1)], &options).unwrap();
    // The front is the lower half of the picture, the top the upper one.
    let area = |path: &str| loops(path)[0].iter().map(|at| at[1]).max();
    let mut areas: Vec<(Option<i32>, &str)> = (paths(&drawn).into_iter().map(area))
        .zip(drawn.split("<path fill=\"#").skip(1).map(|a| &a[..6]))
        .collect();
    areas.sort_unstable();
    assert_eq!(areas.len(), 2);
    assert!(areas[0].1 > areas[1].1, "{areas:?}");
}

#[test]
fn a_surface_of_many_triangles_is_a_few_paths() {
    // A sphere of 5,000 triangles.
    let (rings, sides) = (51, 50);
    let vertices = Array3::from_shape_fn((1, rings * sides, 3), |(_, v, axis)| {
        let up = std::f32::consts::PI * (v / sides) as f32 / (rings - 1) as f32;
        let around = std::f32::consts::TAU * (v % sides) as f32 / sides as f32;
        [up.sin() * around.sin(), up.cos(), up.sin() * around.cos()][axis]
    });
    let mut faces = Vec::new();
    for r in 0..rings - 1 {
        for s in 0..sides {
            let at = |r: usize, s: usize| (r * sides + s % sides) as u32;
            let [a, b, c, d] = [at(r, s), at(r + 1, s), at(r + 1, s + 1), at(r, s + 1)];
            faces.extend([[a, b, c], [a, c, d]]);
        }
    }
    let drawn = svg(&scene(&vertices, &faces), &[row(1)], &level()).unwrap();
    well_formed(&drawn);
    let paths = paths(&drawn);
    assert!((4..200).contains(&paths.len()), "{}", paths.len());
    assert!(drawn.len() < 40_000, "{}", drawn.len());
}

#[test]
fn rows_captions_and_a_bar_of_known_length() {
    let ((one, faces), mut hostile) = (cube(), row(1));
    let moved = Array3::from_shape_fn((3, 8, 3), |(t, v, a)| {
        50.0 * one[[0, v, a]] + (t * 40 * (a % 2)) as f32
    });
    hostile.name = "</text><script>".into();
    hostile.stills[0].caption = "a & b".into();
    let mut scene = scene(&moved, &faces);
    (scene.title, scene.credit) = ("<t>", Some("owed & due"));
    let drawn = svg(&scene, &[row(3), hostile.clone()], &Options::default()).unwrap();
    well_formed(&drawn);
    assert!(drawn.contains("frame 2") && drawn.contains("a &amp; b"));
    assert!(!drawn.contains("<script") && !drawn.contains(" cm<"));
    scene.in_cm = true;
    let drawn = svg(&scene, &[row(3), hostile], &Options::default()).unwrap();
    assert!(drawn.contains(">50 cm</text>"), "{drawn}");
}

#[test]
fn meshes_of_several_figures_stand_on_one_ground() {
    let (one, faces) = cube();
    let moved = Array3::from_shape_fn((2, 8, 3), |(t, v, a)| one[[0, v, a]] + (9 * t * a) as f32);
    let mut scene = scene(&moved, &faces);
    let high = one.mapv(|v| v + 70.0);
    scene.figures.push(MeshFigure {
        vertices: high.view(),
        ..scene.figures[0]
    });
    // The upper edges of the cubes in a picture.
    let tops = |row: Row| -> Vec<i32> {
        let drawn = svg(&scene, &[row], &level()).unwrap();
        let top = |p: &&str| loops(p)[0].iter().map(|at| at[1]).min();
        paths(&drawn).iter().filter_map(top).collect()
    };
    let mut both = row(2);
    let frames = tops(both.clone());
    assert!(
        frames[0] > frames[1],
        "the second frame is higher: {frames:?}"
    );
    (both.stills[1].figure, both.stills[1].frame) = (1, 0);
    let figures = tops(both);
    assert_eq!(figures[0], figures[1]);
}

#[test]
fn nothing_and_flat_meshes_are_drawn() {
    well_formed(&svg(&MeshScene::default(), &[], &level()).unwrap());
    let (_, faces) = cube();
    for vertices in [Array3::zeros((1, 8, 3)), Array3::from_elem((1, 8, 3), 1e9)] {
        let drawn = svg(&scene(&vertices, &faces), &[row(1)], &level()).unwrap();
        well_formed(&drawn);
        assert!(!drawn.contains("NaN") && !drawn.contains("inf"));
    }
}

#[test]
fn what_is_not_there_is_refused() {
    let (vertices, faces) = cube();
    let scene = scene(&vertices, &faces);
    let e = svg(&scene, &[row(2)], &level()).unwrap_err();
    assert!(e.to_string().contains("frame 1: there are 1"), "{e}");
    let mut other = row(1);
    other.stills[0].figure = 1;
    assert!(svg(&scene, &[other], &level()).is_err());
    let bad = MeshScene {
        figures: vec![MeshFigure {
            faces: &[],
            ..scene.figures[0]
        }],
        ..scene.clone()
    };
    assert!(svg(&bad, &[row(1)], &level()).is_err());
}
