use super::packed::tests::{unpacked, unpacked_faces};
use super::*;
use crate::mesh_scene::tests::{cube, scene};
use ndarray::Array3;

/// The cube, shaken.
fn motion(frames: usize) -> (Array3<f32>, Vec<[u32; 3]>) {
    let (one, faces) = cube();
    let moved = Array3::from_shape_fn((frames, 8, 3), |(t, v, a)| {
        one[[0, v, a]] + ((t * t * (v + 9) * (a + 3)) as f32).sin()
    });
    (moved, faces)
}

/// The scene between the page's own script tags, as a browser finds it.
fn data(page: &str) -> Value {
    let (_, after) = page
        .split_once("<script type=\"application/json\">")
        .unwrap();
    serde_json::from_str(after.split("</script").next().unwrap()).unwrap()
}

/// The vertices of a figure as the script finds them.
fn vertices(figure: &Value) -> Array3<f64> {
    let text = |name: &str| figure[name].as_str().unwrap().to_string();
    let packed = Packed {
        step: figure["step"].as_f64().unwrap(),
        origins: serde_json::from_value(figure["origins"].clone()).unwrap(),
        positions: text("places"),
        faces: text("faces"),
    };
    unpacked(&packed, figure["vertices"].as_u64().unwrap() as usize)
}

#[test]
fn the_page_holds_every_frame_within_the_error_that_it_names() {
    let (moved, faces) = motion(7);
    let mut scene = scene(&moved, &faces);
    scene.in_cm = true;
    let page = page(&scene, None).unwrap();
    let data = data(&page);
    assert_eq!((&data["frames"], &data["every"]), (&json!(7), &json!(1)));
    let figure = &data["figures"][0];
    assert_eq!(unpacked_faces(figure["faces"].as_str().unwrap()), faces);
    let back = vertices(figure);
    assert_eq!(back.dim(), (7, 8, 3));
    let (_, after) = page.split_once("by at most ").unwrap();
    let named: f64 = after.split(" mm").next().unwrap().parse().unwrap();
    for (found, v) in back.iter().zip(&moved) {
        // Three digits after the point are written.
        assert!(10.0 * (found - f64::from(*v)).abs() <= named + 0.0006);
    }
}

#[test]
fn every_few_frames_and_figures_of_one_frame() {
    let ((moved, faces), (one, _)) = (motion(10), cube());
    let labels: Vec<String> = (0..10).map(|i| format!("f{i}")).collect();
    let mut scene = scene(&moved, &faces);
    scene.figures[0].labels = &labels;
    let still = MeshFigure {
        name: "still",
        vertices: one.view(),
        ..scene.figures[0]
    };
    scene.figures.push(still);
    scene.rate = Some(60.0);
    let page = page(&scene, Some(3)).unwrap();
    let data = data(&page);
    assert_eq!((&data["frames"], &data["rate"]), (&json!(4), &json!(20.0)));
    assert_eq!(
        data["figures"][0]["labels"],
        json!(["f0", "f3", "f6", "f9"])
    );
    assert_eq!(data["figures"][1]["frames"], 1);
    assert!(page.contains("One frame of every 3 is shown (there are 10)"));
    assert_eq!(vertices(&data["figures"][0]).dim().0, 4);
}

#[test]
fn a_long_scene_keeps_every_few_frames() {
    let (moved, faces) = motion(200);
    let scene = scene(&moved, &faces);
    let whole = page(&scene, None).unwrap();
    assert_eq!(data(&whole)["every"], 1);
    assert_eq!(whole, page(&scene, None).unwrap());
    let small = page_within(&scene, None, 2_000).unwrap();
    let data = data(&small);
    let figure = &data["figures"][0];
    let text = |name: &str| figure[name].as_str().unwrap().len();
    assert!(text("places") + text("faces") <= 2_000);
    let every = data["every"].as_u64().unwrap();
    assert!(every > 1 && data["frames"] == 200u64.div_ceil(every));
    let tiny = page_within(&scene, None, 10).unwrap_err().to_string();
    assert!(tiny.contains("one frame takes"), "{tiny}");
}

#[test]
fn what_cannot_be_played_is_refused() {
    let ((a, faces), (b, _)) = (motion(3), motion(4));
    let mut scene = scene(&a, &faces);
    assert_eq!(page(&scene, Some(0)).unwrap_err().exit_code(), 2);
    let other = MeshFigure {
        name: "other",
        vertices: b.view(),
        ..scene.figures[0]
    };
    scene.figures.push(other);
    let e = page(&scene, None).unwrap_err().to_string();
    assert!(e.starts_with("m: has 3 meshes, other has 4"), "{e}");
    scene.figures[0].faces = &[];
    let e = page(&scene, None).unwrap_err().to_string();
    assert!(e.contains("no faces"), "{e}");
}

#[test]
fn nothing_is_fetched_and_hostile_text_stays_text() {
    let (moved, faces) = motion(2);
    let hostile = "</script><script>alert(1)</script><!-- {{script}}";
    let labels = vec![hostile.to_string(); 2];
    let mut scene = scene(&moved, &faces);
    (scene.title, scene.note, scene.credit) = (hostile, Some(hostile), Some(hostile));
    (scene.figures[0].name, scene.figures[0].labels) = (hostile, &labels);
    let page = page(&scene, None).unwrap();
    assert_eq!(page.matches("<script").count(), 2);
    assert!(!page.contains("<script>alert"));
    assert_eq!(data(&page)["figures"][0]["name"], hostile);
    for loading in [
        "http://", "https://", "src=", "url(", "@import", "fetch(", "XMLHttp", "import(",
    ] {
        assert!(!page.contains(loading), "{loading}");
    }
    for source in [SCRIPT.as_str(), STYLE] {
        assert!(page.contains(&crate::html::policy_hash(source)));
        assert!(!source.to_lowercase().contains("</s"));
    }
}

#[test]
fn no_figures_and_no_size_make_a_page() {
    let nothing = page(&MeshScene::default(), None).unwrap();
    assert_eq!(data(&nothing)["frames"], 0);
    let flat = Array3::zeros((2, 3, 3));
    let data = data(&page(&scene(&flat, &[[0, 1, 2]]), None).unwrap());
    assert!(!data.to_string().contains("null") && data["size"] == 1.0);
}
