//! Which triangles of a mesh are seen, how light they are, and in which order they may be painted.

use super::Window;
use ndarray::ArrayView2;

/// Samples a unit of the picture (0.1 px). A triangle between all samples is not drawn.
const FINE: f64 = 0.4;
/// Shades, from dark to light.
pub(crate) const SHADES: usize = 14;
/// Where light comes from: right, up, toward the viewer; a unit vector.
const LIGHT: [f64; 3] = [-0.42, 0.58, 0.698];
/// Triangles whose normals have a smaller cosine are shaded apart: edges of a box stay sharp.
const SHARP: f64 = 0.5;

/// Triangles that are painted together: they are of one shade, and nothing else of their layer
/// covers them.
pub(crate) struct Layer {
    /// From 0 (dark).
    pub shade: usize,
    /// The corners, in units of the picture, y down.
    pub triangles: Vec<[[i32; 2]; 3]>,
}

/// A triangle that faces the viewer.
struct Triangle {
    corners: [[i32; 2]; 3],
    /// The depth of each corner, larger toward the viewer.
    depths: [f64; 3],
    shade: usize,
}

/// The triangles that are seen of a mesh, from back to front. Vertices are right, up, toward the
/// viewer.
///
/// Triangles that face away are left out, and so are those that a z-buffer finds hidden. The rest
/// is painted in the order of the mean depths of the triangles, so that of triangles which pass
/// through each other one covers the other. Only where they lie on top of each other does the order
/// matter: a triangle comes into the lowest layer above all others that it covers.
pub(crate) fn layers(
    vertices: ArrayView2<'_, f64>,
    faces: &[[u32; 3]],
    window: &Window,
) -> Vec<Layer> {
    let mut triangles = facing(vertices, faces, window);
    let mut raster = Raster::new(window);
    for (i, triangle) in triangles.iter().enumerate() {
        raster.cover(triangle, |sample, depth| {
            if depth > sample.depth {
                (sample.depth, sample.seen) = (depth, i as u32);
            }
        });
    }
    let mut is_seen = vec![false; triangles.len()];
    for sample in raster.samples.iter().filter(|s| s.seen != u32::MAX) {
        is_seen[sample.seen as usize] = true;
    }
    let mut seen = is_seen.into_iter();
    triangles.retain(|_| seen.next().unwrap_or(false));
    let mean = |t: &Triangle| t.depths.iter().sum::<f64>();
    triangles.sort_by(|a, b| mean(a).total_cmp(&mean(b)));

    let mut layers: Vec<[Vec<[[i32; 2]; 3]>; SHADES]> = Vec::new();
    for triangle in &triangles {
        let mut lowest = 0;
        raster.cover(triangle, |sample, _| {
            if let Some((layer, shade)) = sample.painted {
                let above = u32::from(usize::from(shade) != triangle.shade);
                lowest = lowest.max(layer + above);
            }
        });
        raster.cover(triangle, |sample, _| {
            sample.painted = Some((lowest, triangle.shade as u8));
        });
        if layers.len() <= lowest as usize {
            layers.resize_with(lowest as usize + 1, Default::default);
        }
        layers[lowest as usize][triangle.shade].push(triangle.corners);
    }
    let shades = layers.into_iter().flat_map(|l| l.into_iter().enumerate());
    shades
        .filter(|(_, triangles)| !triangles.is_empty())
        .map(|(shade, triangles)| Layer { shade, triangles })
        .collect()
}

/// The triangles that face the viewer.
fn facing(vertices: ArrayView2<'_, f64>, faces: &[[u32; 3]], window: &Window) -> Vec<Triangle> {
    let at = |v: u32| [0, 1, 2].map(|axis| vertices[[v as usize, axis]]);
    let normals: Vec<[f64; 3]> = faces.iter().map(|f| normal(f.map(at))).collect();
    let around = faces_around(faces, vertices.nrows());
    let triangle = |(face, own): (&[u32; 3], &[f64; 3])| {
        let corners = face.map(|v| window.pixel(at(v)));
        // On the screen, y is down.
        let [a, b, c] = corners.map(|c| c.map(i64::from));
        let turn = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if own[2] <= 0.0 || turn >= 0 {
            return None;
        }
        let light = face.map(|v| corner_lightness(*own, &around[v as usize], &normals));
        let light = light.iter().sum::<f64>() / 3.0;
        Some(Triangle {
            corners,
            depths: face.map(|v| at(v)[2]),
            shade: ((light * SHADES as f64) as usize).min(SHADES - 1),
        })
    };
    faces.iter().zip(&normals).filter_map(triangle).collect()
}

/// The lightness at a corner of a triangle with the normal `own`: smooth over the triangles
/// `around` the corner that make no sharp edge with it.
fn corner_lightness(own: [f64; 3], around: &[u32], normals: &[[f64; 3]]) -> f64 {
    let mut sum = own;
    // A vertex of thousands of triangles must not cost the square of their number.
    for other in around.iter().take(64) {
        let other = normals[*other as usize];
        if dot(unit(own), unit(other)) > SHARP {
            (0..3).for_each(|axis| sum[axis] += other[axis]);
        }
    }
    lightness(unit(sum))
}

/// The triangles at each vertex.
fn faces_around(faces: &[[u32; 3]], vertices: usize) -> Vec<Vec<u32>> {
    let mut around = vec![Vec::new(); vertices];
    for (i, face) in faces.iter().enumerate() {
        for corner in face {
            around[*corner as usize].push(i as u32);
        }
    }
    around
}

/// From 0 to 1: diffuse light, and less of it where the surface turns away, so that outlines are
/// seen on white.
fn lightness(normal: [f64; 3]) -> f64 {
    let diffuse = 0.25 + 0.75 * dot(normal, LIGHT).max(0.0);
    diffuse * (0.55 + 0.45 * (2.0 * normal[2]).clamp(0.0, 1.0))
}

/// The normal of a triangle, of twice its area.
fn normal([a, b, c]: [[f64; 3]; 3]) -> [f64; 3] {
    let less = |p: [f64; 3]| [p[0] - a[0], p[1] - a[1], p[2] - a[2]];
    let (u, v) = (less(b), less(c));
    [
        u[1] * v[2] - u[2] * v[1],
        u[2] * v[0] - u[0] * v[2],
        u[0] * v[1] - u[1] * v[0],
    ]
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = dot(v, v).sqrt().max(f64::MIN_POSITIVE);
    v.map(|c| c / length)
}

/// What is known of a sample.
#[derive(Clone)]
struct Sample {
    depth: f64,
    /// The nearest triangle; `u32::MAX`: none.
    seen: u32,
    /// The layer and the shade painted last.
    painted: Option<(u32, u8)>,
}

/// A grid of samples over the window.
struct Raster {
    wide: usize,
    high: usize,
    samples: Vec<Sample>,
}

impl Raster {
    fn new(window: &Window) -> Raster {
        let [wide, high] = window.size.map(|v| (v * FINE).ceil() as usize + 1);
        let empty = Sample {
            depth: f64::NEG_INFINITY,
            seen: u32::MAX,
            painted: None,
        };
        Raster {
            wide,
            high,
            samples: vec![empty; wide * high],
        }
    }

    /// Visits the samples inside a triangle, each with the triangle's depth there.
    fn cover(&mut self, triangle: &Triangle, mut visit: impl FnMut(&mut Sample, f64)) {
        // Samples are in the middles of the squares of a grid.
        let [a, b, c] = triangle
            .corners
            .map(|c| c.map(|v| f64::from(v) * FINE - 0.5));
        let range = |axis: usize, most: usize| {
            let low = a[axis].min(b[axis]).min(c[axis]).ceil().max(0.0);
            let high = a[axis].max(b[axis]).max(c[axis]).floor();
            low as usize..((high + 1.0).max(0.0) as usize).min(most)
        };
        let cross = |p: [f64; 2], q: [f64; 2], r: [f64; 2]| {
            (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
        };
        let area = cross(a, b, c);
        for y in range(1, self.high) {
            for x in range(0, self.wide) {
                let p = [x as f64, y as f64];
                let weights = [cross(b, c, p), cross(c, a, p), cross(a, b, p)].map(|w| w / area);
                if weights.iter().all(|w| *w >= 0.0) {
                    let depth = dot(weights, triangle.depths);
                    visit(&mut self.samples[y * self.wide + x], depth);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::{Array2, arr2};

    fn window() -> Window {
        Window {
            left: -2.0,
            high: 2.0,
            scale: 100.0,
            size: [400.0, 400.0],
        }
    }

    fn count(vertices: &Array2<f64>, faces: &[[u32; 3]]) -> usize {
        let layers = layers(vertices.view(), faces, &window());
        layers.iter().map(|l| l.triangles.len()).sum()
    }

    #[test]
    fn triangles_that_face_away_or_are_hidden_are_left_out() {
        let far_and_near = arr2(&[
            [-1.0, -1.0, 0.0],
            [1.0, -1.0, 0.0],
            [0.0, 1.0, 0.0],
            [-1.5, -1.5, 1.0],
            [1.5, -1.5, 1.0],
            [0.0, 1.6, 1.0],
        ]);
        assert_eq!(count(&far_and_near, &[[0, 1, 2]]), 1);
        assert_eq!(count(&far_and_near, &[[0, 2, 1]]), 0);
        assert_eq!(count(&far_and_near, &[[0, 1, 2], [3, 4, 5]]), 1);
        // A back face in front hides nothing.
        assert_eq!(count(&far_and_near, &[[0, 1, 2], [3, 5, 4]]), 1);
        // Seen from its edge, and without area.
        assert_eq!(count(&far_and_near, &[[0, 1, 1]]), 0);
        assert_eq!(count(&far_and_near, &[]), 0);
    }

    #[test]
    fn the_nearer_of_two_is_painted_later() {
        // The same pair in both orders; the near one leans back and is lighter.
        let vertices = arr2(&[
            [-1.0, -1.0, 0.0],
            [1.0, -1.0, 0.0],
            [0.0, 1.0, 0.0],
            [-1.0, 0.0, 1.0],
            [1.0, 0.0, 1.0],
            [0.0, 1.5, 0.4],
        ]);
        for faces in [[[0, 1, 2], [3, 4, 5]], [[3, 4, 5], [0, 1, 2]]] {
            let layers = layers(vertices.view(), &faces, &window());
            assert_eq!(layers.len(), 2);
            assert_ne!(layers[0].shade, layers[1].shade);
            // The near one reaches up to 1.5, which is 50 from the upper edge.
            assert!(layers[1].triangles[0].iter().any(|c| c[1] == 50));
        }
    }

    #[test]
    fn triangles_side_by_side_share_a_layer() {
        let vertices = Array2::from_shape_fn((9, 3), |(v, axis)| match axis {
            0 => (v % 3) as f64 - 1.0,
            1 => (v / 3) as f64 - 1.0,
            _ => 0.1 * v as f64,
        });
        let faces: Vec<[u32; 3]> = [0, 1, 3, 4]
            .iter()
            .flat_map(|v| [[*v, v + 1, v + 4], [*v, v + 4, v + 3]])
            .collect();
        let layers = layers(vertices.view(), &faces, &window());
        assert_eq!((layers.len(), layers[0].triangles.len()), (1, 8));
    }
}
