//! Can an artist take blades out of a running station, redraw them, and put them back?

use std::fs;

use tests::daemon::Daemon;
use tests::programs::{DEADLINE, Program, wait_for};

/// A blade drawn in millimetres, `half` wide to both sides of x, 100 long.
fn drawing(id: &str, half: f32) -> String {
    format!(
        "<svg xmlns='http://www.w3.org/2000/svg' width='100mm' height='120mm' viewBox='0 0 100 120'>\
         <path id='{id}' d='M50 110 C {} 80 {} 40 50 10 C {} 40 {} 80 50 110 Z'/></svg>",
        50.0 + half,
        50.0 + half,
        50.0 - half,
        50.0 - half,
    )
}

#[test]
fn blades_leave_as_drawings_and_meshes_and_come_back_redrawn() {
    // Nothing but what is put there: the recording shows nothing within its window.
    let daemon = Daemon::start(&[("mask.near_m", "0.1".into()), ("mask.far_m", "0.11".into())]);
    let file = |name: &str| daemon.folder().join(name).display().to_string();
    let run = |arguments: &[&str]| daemon.client(&[&["blades"], arguments].concat());
    let done = |arguments: &[&str]| {
        let finished = run(arguments);
        assert_eq!(finished.code, Some(0), "{arguments:?}: {finished:?}");
        finished.stdout
    };
    let width_mm = |name: &str| -> f64 {
        let shown: serde_json::Value = serde_json::from_str(&done(&["show", name, "--json"])).expect("JSON");
        shown["max_width_m"].as_f64().expect("a number") * 1e3
    };

    let empty = run(&["export", &file("none.svg")]);
    assert_eq!(empty.code, Some(1), "{empty:?}");
    assert!(!daemon.folder().join("none.svg").exists());

    fs::write(file("fern.svg"), drawing("fern", 6.0)).expect("room");
    let said = done(&["import", &file("fern.svg")]);
    assert!(
        said.starts_with("fern: 100.0 mm long, 9.0 mm wide, ") && said.contains(" % like its outline"),
        "{said}"
    );
    assert_eq!(said.lines().count(), 1, "{said}");
    // A cubic with both handles 6 mm aside reaches three quarters of that.
    assert!((width_mm("fern") - 9.0).abs() < 0.2, "{} mm", width_mm("fern"));

    done(&["export", &file("out.svg"), "fern"]);
    done(&["export", &file("out.glb")]);
    assert!(fs::read_to_string(file("out.svg")).expect("written").contains("id=\"fern\""));
    assert_eq!(&fs::read(file("out.glb")).expect("written")[..4], b"glTF");

    // What was exported comes back as what it was, over itself; so does another drawing of that name.
    let said = done(&["import", &file("out.svg")]);
    assert!(said.contains("midrib as drawn") && said.contains("the one before is in the history"), "{said}");
    assert!((width_mm("fern") - 9.0).abs() < 0.3, "{} mm", width_mm("fern"));
    fs::write(file("fern.svg"), drawing("fern", 12.0)).expect("room");
    done(&["import", &file("fern.svg"), "--length-mm", "50"]);
    assert!((width_mm("fern") - 9.0).abs() < 0.2, "twice as wide and half as long: {} mm", width_mm("fern"));
    done(&["import", &file("fern.svg")]);
    assert!((width_mm("fern") - 18.0).abs() < 0.4, "{} mm", width_mm("fern"));
    done(&["restore", "fern"]);
    assert!((width_mm("fern") - 9.0).abs() < 0.2, "{} mm", width_mm("fern"));

    // Its weight and its pin are not the drawing's to change.
    let own = daemon.blades().join("fern.toml");
    let text = fs::read_to_string(&own).expect("there");
    let weighed = text.replace("mix = 1.0", "mix = 7.0").replace("pinned = false", "pinned = true");
    assert_ne!(weighed, text);
    fs::write(&own, weighed).expect("room");
    let kept = || {
        let shown: serde_json::Value =
            serde_json::from_str(&done(&["show", "fern", "--json"])).expect("JSON");
        (shown["mix"].as_f64(), shown["pinned"].as_bool())
    };
    wait_for(DEADLINE, || (kept() == (Some(7.0), Some(true))).then_some(())).expect("it is read again");
    fs::write(file("fern.svg"), drawing("fern", 8.0)).expect("room");
    done(&["import", &file("fern.svg")]);
    assert!((width_mm("fern") - 12.0).abs() < 0.3, "{} mm", width_mm("fern"));
    assert_eq!(kept(), (Some(7.0), Some(true)));

    assert!(done(&["show", "fern"]).contains("captured  20"), "a date: {}", done(&["show", "fern"]));
    let own = daemon.blades().join("fern.toml").display().to_string();
    fs::copy(own, file("moss.toml")).expect("room");
    // The same id under another name: a copy is another blade.
    assert_eq!(done(&["import", &file("moss.toml")]), "moss: put into the library\n");
    assert!((width_mm("moss") - width_mm("fern")).abs() < 1e-6);
    done(&["remove", "moss"]);
    fs::write(file("latin.toml"), b"format = 1\n# \xe9\n").expect("room");
    assert!(
        run(&["import", &file("latin.toml")]).stderr.contains("latin.toml:2:3: the byte 0xe9 is not UTF-8")
    );
    fs::write(file("heavy.toml"), b"format = 1\nmix = -1.0\nknots = []\n").expect("room");
    assert!(run(&["import", &file("heavy.toml")]).stderr.contains("heavy.toml:"));
    let text = fs::read_to_string(file("moss.toml")).expect("there");
    let without_id: Vec<&str> = text.lines().filter(|line| !line.starts_with("id ")).collect();
    fs::write(file("moss.toml"), without_id.join("\n")).expect("room");
    done(&["import", &file("moss.toml"), "--name", "lichen"]);
    assert!((width_mm("lichen") - width_mm("fern")).abs() < 1e-6);

    // Two paths of one id, and two that are called as Inkscape does.
    let pair = drawing("reed", 5.0).replace(
        "</svg>",
        "<path id='reed' d='M80 110 L 84 60 L 80 10 L 76 60 Z'/>\
         <path id='path846' xmlns:inkscape='http://www.inkscape.org/namespaces/inkscape' inkscape:label='sedge' \
         d='M20 110 L 24 60 L 20 10 L 16 60 Z'/></svg>",
    );
    fs::write(file("pair.svg"), pair).expect("room");
    let said = done(&["import", &file("pair.svg")]);
    assert!(
        said.contains("reed-2: ") && said.contains("the drawing calls it \"reed\", which is taken"),
        "{said}"
    );
    assert!((width_mm("reed") - 7.5).abs() < 0.2, "{} mm", width_mm("reed"));
    assert!((width_mm("reed-2") - 8.0).abs() < 0.2, "{} mm", width_mm("reed-2"));
    assert!((width_mm("sedge") - 8.0).abs() < 0.2, "{} mm", width_mm("sedge"));

    // Of several blades, those that are none do not keep out the others.
    let several =
        drawing("a", 5.0).replace("</svg>", "<path id='.' d='M80 110 L 84 60 L 80 10 L 76 60 Z'/></svg>");
    let several =
        several.replace("<path id='a'", "<path id='..' d='M20 110 L 24 60 L 20 10 L 16 60 Z'/><path id='a'");
    fs::write(file("several.svg"), several).expect("room");
    let some = run(&["import", &file("several.svg")]);
    assert_eq!(some.code, Some(1), "{some:?}");
    assert!(
        some.stderr.contains("several.svg: 2 of its 3 blades were not put") && some.stderr.ends_with("it.\n")
    );
    assert_eq!(some.stderr.lines().count(), 1, "{some:?}");
    assert!((width_mm("a") - 7.5).abs() < 0.2, "{} mm", width_mm("a"));

    // What was cut off a name, what was made up, and what was not used is said; a hyphen may begin a name.
    let long = "long ".repeat(20);
    let odd = drawing("-reed", 5.0).replace(
        "</svg>",
        &format!(
            "<path id='{long}' d='M80 110 L 84 60 L 80 10 L 76 60 Z'/><path d='M20 110 L 24 60 L 20 10 L 16 60 Z'/>\
             <path id='midrib-lost' d='M1 1 L 1 9' stroke='red'/></svg>"
        ),
    );
    fs::write(file("odd.svg"), odd).expect("room");
    let said = done(&["import", &file("odd.svg")]);
    for words in [
        "-reed: 100.0 mm long",
        "the drawing calls it \"long long",
        "which is taken, too long",
        "nothing in the drawing gives it a name",
        "midrib \"midrib-lost\" is not used",
    ] {
        assert!(said.contains(words), "does not say {words:?}: {said}");
    }
    done(&["import", &file("fern.svg"), "--name", "-moss"]);
    let hyphens = daemon.folder().join("hyphens.svg").display().to_string();
    let socket = daemon.socket().display().to_string();
    let exported =
        Program::Capture.run(["blades", "export", "--socket", &socket, &hyphens, "--", "-reed", "-moss"]);
    assert_eq!(exported.code, Some(0), "{exported:?}");
    assert_eq!(done(&["import", &hyphens]).lines().filter(|line| line.starts_with('-')).count(), 2);

    // Longer than the station reads: it is said here, before the station hangs up.
    let own = without_id.join("\n");
    fs::write(file("long.toml"), format!("# {}\n{own}", "moss ".repeat(20_000))).expect("room");

    fs::write(file("text.svg"), "<svg xmlns='http://www.w3.org/2000/svg'><text>no</text></svg>")
        .expect("room");
    let crossed = "<svg xmlns='http://www.w3.org/2000/svg' width='100mm' height='120mm' viewBox='0 0 100 120'>\
                   <path id='fork' d='M46 110 V72 H10 V10 H12 V70 H46 V10 H48 V70 H88 V10 H90 V72 H48 V108 L40 112 z'/></svg>";
    fs::write(file("fork.svg"), crossed).expect("room");
    fs::write(file("bad.toml"), "format = 1\nknots = 7\n").expect("room");
    for (arguments, code, words) in [
        (vec!["import", "/nowhere.svg"], 2, "/nowhere.svg"),
        (vec!["import", "fern.png"], 2, ".svg or .toml"),
        (vec!["export", "fern.png"], 2, ".svg or .glb"),
        (vec!["export", "/nowhere/fern.svg"], 1, "/nowhere/fern.svg"),
        (vec!["export", &file("out.svg"), "heather"], 1, "heather"),
        (vec!["import", &file("text.svg")], 2, "closed path"),
        (vec!["import", &file("fork.svg")], 2, "path \"fork\": its outline crosses itself"),
        (vec!["import", &file("bad.toml")], 2, "bad.toml:2"),
        (vec!["import", &file("long.toml")], 2, "expected 65536 at most; take comments"),
        (vec!["import", &file("fern.svg"), "--name", "a/b"], 2, "slash"),
        (vec!["import", &file("fern.svg"), "--length-mm", "0"], 2, "1 to 10000"),
        (vec!["import", &file("moss.toml"), "--length-mm", "9"], 2, "--length-mm"),
    ] {
        let refused = run(&arguments);
        assert_eq!(refused.code, Some(code), "{arguments:?}: {refused:?}");
        assert!(refused.stderr.contains(words), "{arguments:?}: {refused:?}");
    }
}

#[test]
fn what_is_exported_of_many_blades_is_imported_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let blades = folder.path().join("state/blades");
    fs::create_dir_all(&blades).expect("room");
    // More than one drawing once could hold.
    let count = 300;
    for number in 0..count {
        let height_m = 0.1 + 1e-4 * f64::from(number);
        let text = format!(
            "format = 1\nknots = [\n  {{ position_m = [0.0, 0.0, 0.0], half_width_m = [0.004, 0.003] }},\n  {{ position_m = [0.0, {height_m:?}, 0.0], half_width_m = [0.0, 0.0] }},\n]\n"
        );
        fs::write(blades.join(format!("b{number}.toml")), text).expect("room");
    }
    let settings = [("mask.near_m", "0.1".into()), ("mask.far_m", "0.11".into())];
    let daemon = Daemon::start_in(folder, &settings);
    let drawing = daemon.folder().join("all.svg").display().to_string();
    assert_eq!(daemon.client(&["blades", "export", &drawing]).code, Some(0));
    let imported = daemon.client(&["blades", "import", &drawing]);
    assert_eq!((imported.code, imported.stdout.lines().count()), (Some(0), count as usize), "{imported:?}");
    assert!(imported.stdout.lines().all(|line| line.contains("midrib as drawn; ")), "{}", imported.stdout);
    assert_eq!(daemon.client(&["blades", "list"]).stdout.lines().count(), count as usize);
}
