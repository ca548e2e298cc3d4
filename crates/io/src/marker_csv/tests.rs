use super::*;

fn take(text: &str) -> Result<MarkerTake> {
    let input = Input::new("x.csv", std::io::Cursor::new(text.as_bytes().to_vec()))?;
    read(input, None, false)
}

fn fails(text: &str, part: &str) {
    let said = take(text).unwrap_err().to_string();
    assert!(said.contains(part), "{said}");
}

const OBJECTS: &str = "Objects\n100\n,,Global Angle (Quaternion) Wand:Wand,,,,,,,Cart:Lid,,,,,,\n\
    Frame,Sub Frame,RX,RY,RZ,RW,TX,TY,TZ,RX,RY,RZ,RW,TX,TY,TZ\n\
    ,,,,,,mm,mm,mm,,,,,mm,mm,mm\n\
    5,0,.10,.2,.3,.9,10,20,30,0,0,0,1,40,50,60\n7,0,.1,.2,.3,.9,10,20,31,,,,,,,\n";

#[test]
fn rigid_bodies_of_tracker_are_points_with_rotations() {
    let read = take(OBJECTS).unwrap();
    assert_eq!(read.points, ["Wand", "Cart:Lid"]);
    assert_eq!(
        (read.first_frame, read.rate, read.units.as_deref()),
        (5, Some(100.0), Some("mm"))
    );
    assert_eq!(read.xyz.row(0).to_vec(), [10., 20., 30., 40., 50., 60.]);
    assert!(read.xyz[[2, 3]].is_nan() && read.xyz[[2, 2]] == 31.0 && read.xyz.nrows() == 3);
    assert_eq!(
        read.carried.names[2..5],
        ["Wand.qz", "Wand.qw", "Cart:Lid.qx"]
    );
    let rows = read.carried_rows();
    assert_eq!(rows.cells(0)[..2], [".10", ".2"]);
    assert_eq!(
        (&*rows.cells(1)[0], &*rows.cells(2)[0], &*rows.cells(2)[4]),
        ("", ".1", "")
    );
    // The way back changes what is new.
    let mut new = read.xyz.clone();
    assert_eq!(
        read.cells
            .with_points(OBJECTS.as_bytes(), new.view(), new.view()),
        OBJECTS.as_bytes()
    );
    new[[2, 1]] = 21.5;
    let bytes = read
        .cells
        .with_points(OBJECTS.as_bytes(), read.xyz.view(), new.view());
    assert_eq!(bytes, OBJECTS.replace("20,31", "21.5,31").as_bytes());
    // Angles, in another order.
    let angles = "Objects\r\n50\r\n,,Wand:Wand,,,,,\r\nFrame,Sub Frame,TX,TY,TZ,RX,RY,RZ\r\n\
                  ,,mm,mm,mm,deg,deg,deg\r\n1,0,1,2,3,4,5,6\r\n";
    let read = take(angles).unwrap();
    assert_eq!(
        (&read.points[..], &*read.carried.names[0]),
        (&["Wand".to_string()][..], "Wand.rx")
    );
    assert_eq!(
        (read.carried_rows().cells(0), read.notes.len()),
        (vec!["4".into(), "5".into(), "6".into()], 0)
    );
    let radians = take(&angles.replace("deg", "rad")).unwrap();
    assert_eq!(radians.notes, ["its rotations are in radians, and stay so"]);
}

#[test]
fn markers_come_before_rigid_bodies() {
    let markers = "Trajectories\n100\n,,A,,\nFrame,Sub Frame,X,Y,Z\n,,mm,mm,mm\n1,0,1,2,3\n";
    let alone = take(markers).unwrap();
    for others in [OBJECTS, "Objects\n100\n", "Objects\n100\n,,A\nx\n\n1,u\n"] {
        for text in [
            format!("{others}\n{markers}"),
            format!("{markers}\n{others}"),
        ] {
            let read = take(&text).unwrap();
            assert_eq!(
                (&read.points, &read.xyz),
                (&alone.points, &alone.xyz),
                "{text}"
            );
            assert_eq!(
                read.notes,
                ["its other sections are not converted: Objects"]
            );
        }
    }
    fails(
        "Objects\n100\n\nDevices\n",
        "expected the names of the objects above RX",
    );
    fails(
        &OBJECTS.replace("10,20,31", "10,u,31"),
        "x.csv:7: expected a number",
    );
    let devices = format!("Devices\n1000\n,,F\nFrame,Sub Frame,Fx\n,,N\n1,0,2\n\n{OBJECTS}");
    let notes = take(&devices).unwrap().notes;
    assert!(
        notes.contains(&"its other sections are not converted: Devices".to_string()),
        "{notes:?}"
    );
}
