use super::super::MeshFormat;
use super::super::tests::testdata::{cube, message, read};

const TEXT: &str = "ply
format ascii 1.0
comment caf\u{e9}
element camera 1
property float f
property list uchar int ids
element vertex 4
property uchar red
property double z
property float x
property short y
property float nx
element face 2
property list uchar uchar colors
property list int double vertex_index
end_header
0.5 2 7 8
255 0 0 0 nan
255 0.25 1 0 nan

255 0 1 1 nan
255 0 0 1 nan
0 4 0 1 2 3
1 9 3 0 1 3
";

#[test]
fn text_with_other_elements_and_properties() {
    for text in [TEXT.to_string(), TEXT.replace('\n', "\r\n")] {
        let mesh = read("a.ply", text).unwrap();
        assert_eq!(mesh.faces, [[0, 1, 2], [0, 2, 3], [0, 1, 3]]);
        assert_eq!(mesh.vertices[1], [1.0, 0.0, 0.25]);
    }
}

#[test]
fn big_endian_with_other_properties() {
    let mut bytes = b"ply\nformat binary_big_endian 1.0\nelement face 1\n\
        property char flag\nproperty list ushort short vertex_indices\nelement vertex 3\n\
        property double y\nproperty int x\nproperty list uchar float w\nproperty float z\n\
        end_header\n"
        .to_vec();
    bytes.extend([255, 0, 3, 0, 2, 0, 1, 0, 0]);
    for i in 0..3_i32 {
        bytes.extend((f64::from(i) / 3.0).to_be_bytes());
        bytes.extend((-i).to_be_bytes());
        bytes.extend([1, 9, 9, 9, 9]);
        bytes.extend((i as f32 / 4.0).to_be_bytes());
    }
    let mesh = read("a.ply", &bytes).unwrap();
    assert_eq!(mesh.faces, [[2, 1, 0]]);
    assert_eq!(mesh.vertices[2], [-2.0, 2.0 / 3.0, 0.5]);
    bytes.pop();
    assert!(message("a.ply", &bytes).starts_with("a.ply: vertex 2: the file ends"));
}

#[test]
fn bad_text_is_named() {
    for (from, to, expected) in [
        (
            "255 0.25 1 0 nan",
            "255 0.25 1 0 nan 7",
            "a.ply:19: expected 5 values, found 6",
        ),
        ("format ascii 1.0\n", "", "a.ply:15: the header has no line"),
        ("format ascii", "format utf8", "a.ply:2: expected format"),
        ("property double z", "property double w", "x, y and z"),
        (
            "property double z",
            "property long z",
            "a.ply:9: expected a type",
        ),
        (
            "property float x",
            "property float z",
            "a second property z",
        ),
        (
            "element face 2",
            "element vertex 2",
            "a second element vertex",
        ),
        ("vertex_index", "corners", "needs one list vertex_indices"),
        ("vertex 4", "vertex -4", "a.ply:7: expected a count"),
        ("vertex 4", "point 4", "a.ply: has no element vertex"),
        ("end_header", "end", "a.ply:16: expected element"),
        (
            "end_header",
            "element x 9999999999\nend_header",
            "no properties",
        ),
        ("face 2", "face 4000000000", "a.ply:24: ends before"),
        ("face 2", "face 1", "a.ply:24: has more rows"),
        ("vertex 4", "vertex 3", "a.ply:22: has only 5 values"),
        ("255 0.25 1", "255 x 1", "a.ply:19: expected a number"),
        ("255 0.25 1", "255 inf 1", "a.ply:19: expected coordinates"),
        ("255 0.25 1", "0.25 1", "a.ply:19: has only 4 values"),
        ("3 0 1 3", "3 0 1 4", "a.ply:24: the face names vertex 4"),
        ("3 0 1 3", "3 0 1 1.5", "names vertex 1.5"),
        ("3 0 1 3", "3 0 1 -1", "names vertex -1"),
        ("3 0 1 3", "2 0 1", "a.ply:24: the face has 2 corners"),
        ("3 0 1 3", "4e9 0 1", "a.ply:24: has only 5 values"),
        (
            "3 0 1 3",
            "-3 0 1",
            "the list vertex_index has the length -3",
        ),
    ] {
        assert!(TEXT.contains(from), "{from}");
        let text = message("a.ply", TEXT.replacen(from, to, 1));
        assert!(text.contains(expected), "{from} -> {to}: {text}");
    }
    assert!(message("a.ply", &TEXT[..35]).contains("ends before end_header"));
    let many = "property float a\n".repeat(2000);
    assert!(message("a.ply", format!("ply\nelement a 1\n{many}")).contains("second"));
    let many: String = (0..2000).map(|i| format!("element e{i} 1\n")).collect();
    assert!(message("a.ply", format!("ply\n{many}")).contains("more than 1000"));
}

#[test]
fn bad_binary_is_named() {
    let sound = cube().to_bytes(MeshFormat::Ply).unwrap();
    let edit = |from: &str, to: &str| {
        let at = sound.windows(from.len()).position(|w| w == from.as_bytes());
        let (head, rest) = sound.split_at(at.unwrap());
        message("a.ply", [head, to.as_bytes(), &rest[from.len()..]].concat())
    };
    let text = edit("vertex 8", "vertex 8000000000");
    assert!(text.contains("vertex: 252 bytes are too few"), "{text}");
    let text = edit("vertex 8", "vertex 18446744073709551615");
    assert!(text.contains("too few"), "{text}");
    let text = edit("face 12", "face 11");
    assert!(text.contains("has more bytes"), "{text}");
    let mut bad = sound.clone();
    let end = bad.len();
    bad[end - 1] = 1;
    let text = message("a.ply", &bad);
    assert!(text.starts_with("a.ply: face 11: the face names"), "{text}");
    bad[end - 13] = 200;
    let text = message("a.ply", &bad[..]);
    assert!(text.starts_with("a.ply: face 11: "), "{text}");
    let text = message("a.ply", &sound[..end - 1]);
    assert!(text.contains("the file ends inside it"), "{text}");
}
