use super::*;

fn take(text: &str) -> Result<MarkerTake> {
    let input = Input::new("x.csv", std::io::Cursor::new(text.as_bytes().to_vec()))?;
    read(input, None, false)
}

fn fails(text: &str, part: &str) {
    let said = take(text).unwrap_err().to_string();
    assert!(said.contains(part), "{said}");
}

const LONG: &str = "frame,marker,x,y,z\n1,b,1,2,3\n1,a,4,5,6\n2,b,7,8,9\n4,a,-1,,0\n";

#[test]
fn long_tables_may_have_any_order() {
    let wanted = take(LONG).unwrap();
    assert_eq!(
        (wanted.points.join(" "), wanted.first_frame),
        ("b a".into(), 1)
    );
    assert_eq!(wanted.xyz.row(0).to_vec(), [1., 2., 3., 4., 5., 6.]);
    assert_eq!(wanted.xyz.dim(), (4, 6));
    assert!(wanted.xyz.row(2).iter().all(|v| v.is_nan()) && wanted.xyz[[3, 4]].is_nan());
    assert_eq!((wanted.xyz[[3, 3]], wanted.xyz[[1, 2]]), (-1.0, 9.0));
    assert_eq!(
        (wanted.rate, wanted.units, wanted.times),
        (None, None, None)
    );
    // Other separators, titles and orders of the columns and the rows.
    let lines: Vec<Vec<&str>> = LONG.lines().map(|line| line.split(',').collect()).collect();
    for (titles, separator, order) in [
        ("z;Frame_Number;y;keypoint;x", ";", [4, 0, 3, 1, 2]),
        ("Joint_Name\tz\ty\tx\tframe", "\t", [1, 4, 3, 2, 0]),
    ] {
        let mut rows: Vec<String> = (lines[1..].iter())
            .map(|cells| order.map(|c| cells[c]).join(separator))
            .collect();
        rows.swap(1, 2);
        let other = take(&format!("{titles}\n{}", rows.join("\n"))).unwrap();
        assert_eq!(other.points, ["b", "a"]);
        let same = other.xyz.iter().zip(&wanted.xyz);
        assert!(
            same.into_iter().all(|(a, b)| a.to_bits() == b.to_bits()),
            "{titles}"
        );
    }
}

#[test]
fn long_tables_tell_times_units_people_and_what_stays() {
    let text = "index,time_ms,person,joint,x (mm),y (mm),z (mm),likelihood\n\
                0,0,Ann,hip,1,2,3,0.5\n1,0,Ben,hip,4,5,6,0.5\n2,20,Ann,hip,1,2,3,0.5\n";
    let read = take(text).unwrap();
    assert_eq!(read.points, ["Ann:hip", "Ben:hip"]);
    assert_eq!((read.units.as_deref(), read.rate), (Some("mm"), Some(50.0)));
    assert_eq!((read.times, read.xyz.nrows()), (Some(vec![0.0, 0.02]), 2));
    assert_eq!(
        read.notes,
        ["its other columns are not converted: index, likelihood"]
    );
    // The times of frames that are left out follow.
    let read = take("frame,time,name,x,y,z\n1,0.5,a,1,2,3\n2,0.6,a,1,2,3\n4,0.8,a,1,2,3\n");
    let read = read.unwrap();
    assert_eq!((read.xyz.nrows(), read.rate), (4, Some(10.0)));
    let times = read.times.unwrap();
    assert!(
        (times[2] - 0.7).abs() < 1e-9 && (times[3] - 0.8).abs() < 1e-9,
        "{times:?}"
    );
}

#[test]
fn decimals_of_long_tables_may_stand_behind_a_comma() {
    let points = "frame;time;point;x;y;z\n1;0.01;a;-1.5;2;3.25\n2;0.02;a;1.5;;0.125\n";
    let commas = take(&points.replace('.', ",")).unwrap();
    assert_eq!(commas.xyz.row(0).to_vec(), [-1.5, 2.0, 3.25]);
    assert!(commas.xyz[[1, 1]].is_nan());
    let plain = take(points).unwrap();
    assert_eq!(
        (commas.rate, commas.times),
        (plain.rate, plain.times.clone())
    );
    assert_eq!(plain.xyz.row(0), commas.xyz.row(0));
    // One of them may part thousands.
    fails(
        &points.replace("1.5;;", "1,5;;"),
        "x.csv:3: has numbers with a comma and with a point",
    );
}

#[test]
fn faults_of_long_tables_have_a_place() {
    fails(
        &format!("{LONG}2,b,1,1,1\n"),
        "x.csv:6: has b of this frame a second time, after line 4",
    );
    fails(&LONG.replace("7,8", "7,u"), "x.csv:4: expected a number");
    fails(
        &LONG.replace("2,b", "2.5,b"),
        "x.csv:4: expected a frame's number, found \"2.5\"",
    );
    fails(
        &LONG.replace("7,8,9", "7,8,9,3"),
        "x.csv:4: expected 5 cells, found 6",
    );
    fails("frame,point,x,y,z\n", "x.csv: has no frames");
    fails(
        &LONG[..LONG.len() - 4],
        "ends within a row, after 3 whole ones; the option",
    );
    let cut = LONG.trim_end().as_bytes()[..LONG.len() - 4].to_vec();
    let input = Input::new("x.csv", std::io::Cursor::new(cut)).unwrap();
    assert_eq!(read(input, None, true).unwrap().xyz.nrows(), 2);
    fails(
        &LONG.replace("x,y,z", "x [mm],y [m],z [mm]"),
        "x.csv: has points in mm and in m: convert",
    );
    fails(
        "frame,time,point,x,y,z\n1,0.1,b,1,2,3\n2,0.2,b,1,2,3\n2,0.25,a,1,2,3\n",
        "x.csv:4: has the time 0.25 s in frame 2, line 3 has 0.2 s: split",
    );
    fails(
        "frame,time,point,x,y,z\n1,0.1,b,1,2,3\n1,0.1,a,1,2,3\n1,0.2,c,1,2,3\n",
        "x.csv:4: has the time 0.2 s in frame 1, line 2 has 0.1 s: split",
    );
    let takes = "take,frame,point,x,y,z\nrun,1,a,1,2,3\nrun,2,a,1,2,3\n";
    let one = take(takes).unwrap();
    assert_eq!(
        (one.xyz.nrows(), &*one.notes[0]),
        (2, "its other columns are not converted: take")
    );
    fails(
        &format!("{takes}jump,3,a,1,2,3\n"),
        "x.csv:4: is of take jump after rows of run: split the takes",
    );
    let far = "frame,point,x,y,z\n0,a,1,2,3\n4000000000,a,1,2,3\n";
    fails(far, "x.csv:3: there are more than");
    // Many points that stand once each would fill the memory.
    let many: String = (0..9000).map(|i| format!("{i},p{i},1,2,3\n")).collect();
    fails(&format!("frame,point,x,y,z\n{many}"), "points in all rows");
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
