//! Does the station serve whoever speaks to it, and is it harmed by nothing that anyone sends?

use std::fs;
use std::io::{IoSlice, Read, Write};
use std::mem::MaybeUninit;
use std::os::fd::AsFd;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::time::Duration;

use rustix::net::{SendAncillaryBuffer, SendAncillaryMessage, SendFlags, sendmsg};
use serde_json::{Value, json};
use tests::daemon::Daemon;
use tests::programs::{DEADLINE, Finished, Program, Running, wait_for};
use tests::random::Random;

const FERN: &str = "format = 1\nknots = [\n  { position_m = [0.0, 0.0, 0.0], half_width_m = [0.004, 0.004] },\n  { position_m = [0.0, 0.2, 0.0], half_width_m = [0.0, 0.0] },\n]\n";

/// A daemon with one blade, `fern`, whose recording shows something but is captured by hand alone.
fn with_fern(settings: &[(&str, String)]) -> Daemon {
    with_fern_in(tempfile::tempdir().expect("a folder"), settings)
}

fn with_fern_in(folder: tempfile::TempDir, settings: &[(&str, String)]) -> Daemon {
    let blades = folder.path().join("state/blades");
    fs::create_dir_all(&blades).expect("room");
    fs::write(blades.join("fern.toml"), FERN).expect("room");
    let own = [("capture.hold_s", "60.0".to_owned()), ("source.loop", "true".to_owned())];
    Daemon::start_in(folder, &[&own[..], settings].concat())
}

/// One sentence on stderr, nothing on stdout, the exit code, and these words in the sentence.
#[track_caller]
fn refused(finished: &Finished, code: i32, named: &[&str]) {
    assert_eq!((finished.code, finished.stdout.as_str()), (Some(code), ""), "{finished:?}");
    let sentence = finished.stderr.strip_suffix(".\n").unwrap_or_else(|| panic!("{finished:?}"));
    assert!(!sentence.contains('\n'), "{finished:?}");
    for name in named {
        assert!(sentence.contains(name), "does not say {name:?}: {sentence}");
    }
}

#[test]
fn each_verb_does_what_it_says_and_says_why_when_it_cannot() {
    let daemon = with_fern(&[]);
    let client = |arguments: &[&str]| daemon.client(arguments);
    let status = client(&["status"]);
    assert_eq!(status.code, Some(0), "{status:?}");
    assert!(
        status.stdout.contains("library   1 blade,") && status.stdout.contains("store     ok"),
        "{status:?}"
    );
    let status: Value = serde_json::from_str(&client(&["status", "--json"]).stdout).expect("JSON");
    assert_eq!((&status["blades"], &status["clients"]), (&json!(1), &json!(1)), "{status}");

    assert!(client(&["blades", "list"]).stdout.starts_with("fern  blade   200.0 mm long    8.0 mm wide"));
    let shown: Value =
        serde_json::from_str(&client(&["blades", "show", "fern", "--json"]).stdout).expect("JSON");
    assert_eq!((&shown["length_m"], &shown["mix"]), (&json!(0.2), &json!(1.0)), "{shown}");
    assert!(client(&["blades", "show", "fern"]).stdout.contains("source    made by hand"));

    assert_eq!(client(&["blades", "mix", "fern", "0"]).code, Some(0));
    assert_eq!(client(&["blades", "rename", "fern", "moss"]).code, Some(0));
    refused(&client(&["blades", "show", "heather"]), 1, &["no blade \"heather\"", "blades list"]);
    let gone = client(&["blades", "show", "fern"]);
    let lines: Vec<&str> = gone.stdout.lines().collect();
    assert!(
        gone.code == Some(0) && lines.len() == 4 && lines[1].contains("no blade has this name"),
        "{gone:?}"
    );
    assert!(
        lines[2].starts_with("history   1  until 2") && lines[2].ends_with("mix 0  renamed to \"moss\""),
        "{gone:?}"
    );
    assert!(lines[3].starts_with("          2  until 2") && lines[3].ends_with("mix 1"), "{gone:?}");
    assert_eq!(client(&["blades", "restore", "fern"]).code, Some(0), "the renaming is undone");
    refused(&client(&["blades", "show", "heather"]), 1, &["no blade \"heather\""]);
    assert_eq!(client(&["blades", "restore", "fern"]).code, Some(0), "the weight is undone");
    let fern: Value =
        serde_json::from_str(&client(&["blades", "show", "fern", "--json"]).stdout).expect("JSON");
    assert_eq!((&fern["mix"], &fern["earlier"][0]["blade"]["mix"]), (&json!(1.0), &json!(0.0)), "{fern}");
    assert_eq!(client(&["blades", "restore", "fern", "--back", "1"]).code, Some(0), "and done again");
    refused(&client(&["blades", "restore", "fern", "--back", "9"]), 1, &["not so many", "blades show"]);
    refused(&client(&["blades", "restore", "fern", "--back", "0"]), 2, &["--back", "1 to 100"]);
    assert_eq!(client(&["blades", "rename", "fern", "moss"]).code, Some(0));
    refused(&client(&["blades", "rename", "moss", "moss"]), 1, &["\"moss\"", "choose another name"]);
    refused(&client(&["blades", "rename", "moss", "../moss"]), 2, &["slash", "expected"]);
    refused(&client(&["blades", "mix", "moss", "-1"]), 2, &["-1", "0 to 1000000"]);
    refused(&client(&["blades", "mix", "moss", "nan"]), 2, &["NaN"]);
    refused(
        &client(&["blades", "mix", "moss", "much"]),
        2,
        &["'much'", "expected 0, or a number of 1e-30 to 1000000"],
    );
    refused(&client(&["blades", "restore", "heather"]), 1, &["no earlier blade \"heather\""]);
    assert_eq!(client(&["blades", "remove", "moss"]).code, Some(0));
    refused(&client(&["blades", "remove", "moss"]), 1, &["no blade \"moss\""]);
    assert_eq!(client(&["blades", "restore", "moss"]).code, Some(0));
    let moss: Value =
        serde_json::from_str(&client(&["blades", "show", "moss", "--json"]).stdout).expect("JSON");
    assert_eq!(moss["mix"], json!(0.0));

    let nobody = daemon.folder().join("nobody.socket");
    let nobody = nobody.to_str().expect("UTF-8");
    let mut command = Program::Capture.command(["status", "--socket", nobody]);
    command.env("SWARD_LOG", "off");
    refused(&Running::start(command).finish(DEADLINE), 1, &[nobody, "sward-capture run"]);
}

#[test]
fn who_is_not_listed_may_watch_at_most() {
    if !rustix::process::getuid().is_root() {
        eprintln!("skipped: only root can be somebody else");
        return;
    }
    // Where the build is, strangers may not go; so they get a copy.
    let open_to_all = tempfile::tempdir().expect("a folder");
    fs::set_permissions(open_to_all.path(), PermissionsExt::from_mode(0o755)).expect("it is ours");
    let program = open_to_all.path().join("sward-capture");
    fs::copy(Program::Capture.path(), &program).expect("room");
    let stranger = |daemon: &Daemon, arguments: &[&str]| {
        let mut command = std::process::Command::new(&program);
        command.args(arguments).arg("--socket").arg(daemon.socket()).env("SWARD_LOG", "off");
        command.current_dir("/").uid(4242).gid(4243);
        Running::start(command).finish(DEADLINE)
    };
    let open = ("service.socket_mode", "0o666".to_owned());
    let daemon = with_fern(std::slice::from_ref(&open));
    assert_eq!(stranger(&daemon, &["status"]).code, Some(0));
    refused(&stranger(&daemon, &["blades", "remove", "fern"]), 1, &["does not allow", "service.change"]);
    refused(&stranger(&daemon, &["reload"]), 1, &["does not allow"]);
    assert_eq!(daemon.connect().library(0).len(), 1);

    let daemon = with_fern(&[open.clone(), ("service.watch", "[]".to_owned())]);
    refused(&stranger(&daemon, &["status"]), 1, &["service.watch"]);
    refused(&stranger(&daemon, &["preview", "seen.png"]), 1, &["service.watch"]);
    refused(&stranger(&daemon, &["preview", "--watch"]), 1, &["service.watch"]);
    let daemon = with_fern(&[open.clone(), ("service.change", "[\"@4243\"]".to_owned())]);
    assert_eq!(stranger(&daemon, &["blades", "remove", "fern"]).code, Some(0));

    // One user does not take all connections: of 4 he gets 2.
    let daemon = with_fern(&[open.clone(), ("service.max_connections", "4".to_owned())]);
    let watch = || {
        let mut command = std::process::Command::new(&program);
        command.args(["status", "--watch", "--socket"]).arg(daemon.socket());
        command.current_dir("/").uid(4242).gid(4243);
        Running::start(command)
    };
    let watching = [watch(), watch()];
    let all = wait_for(DEADLINE, || (daemon.connect().status()["clients"] == json!(3)).then_some(()));
    all.expect("two strangers and we");
    refused(&stranger(&daemon, &["status"]), 1, &["2 for this user", "service.max_connections"]);
    assert_eq!(daemon.client(&["status"]).code, Some(0));
    drop(watching);

    // Who may do what can be changed while the station runs.
    let folder = tempfile::tempdir().expect("a folder");
    let config = folder.path().join("station.toml");
    fs::write(&config, "service.change = []\n").expect("room");
    let daemon = with_fern_in(folder, &[open]);
    refused(&stranger(&daemon, &["blades", "remove", "fern"]), 1, &["does not allow"]);
    fs::write(&config, "service.change = [\"4242\"]\n").expect("room");
    assert_eq!(daemon.client(&["reload"]).stdout, "service.change is changed\n");
    assert_eq!(stranger(&daemon, &["blades", "remove", "fern"]).code, Some(0));

    let daemon = with_fern(&[("service.socket_mode", "0o600".to_owned())]);
    let mode = fs::metadata(daemon.socket()).expect("it is there").permissions().mode();
    assert_eq!(mode & 0o777, 0o600);
    refused(&stranger(&daemon, &["status"]), 1, &["Permission denied"]);
}

#[test]
fn what_is_wrong_with_a_call_is_said_and_the_connection_goes_on() {
    let daemon = with_fern(&[]);
    let mut station = daemon.connect();
    let mut error = |message: &str| {
        station.send(message.as_bytes()).expect("it reads");
        station.reply().expect("it answers").0
    };
    let standard = |name: &str, parameters: Value| json!({"error": format!("org.varlink.service.{name}"), "parameters": parameters});
    for (message, expected) in [
        (
            r#"{"method":"io.sward.Station.GetLibrary","parameters":{"after":"now"}}"#,
            standard("InvalidParameter", json!({"parameter": "after"})),
        ),
        (
            r#"{"method":"io.sward.Station.SetMix","parameters":{"name":"fern"}}"#,
            standard("InvalidParameter", json!({"parameter": "mix"})),
        ),
        (
            r#"{"method":"io.sward.Station.GetStatus","parameters":{"fast":true}}"#,
            standard("InvalidParameter", json!({"parameter": "fast"})),
        ),
        (
            r#"{"method":"io.sward.Station.Mow"}"#,
            standard("MethodNotFound", json!({"method": "io.sward.Station.Mow"})),
        ),
        (
            r#"{"method":"io.lawn.Mower.Mow","parameters":{}}"#,
            standard("InterfaceNotFound", json!({"interface": "io.lawn.Mower"})),
        ),
        (
            r#"{"method":"org.varlink.service.GetInterfaceDescription","parameters":{"interface":"io.lawn"}}"#,
            standard("InterfaceNotFound", json!({"interface": "io.lawn"})),
        ),
        (r#"{"parameters":{}}"#, standard("InvalidParameter", json!({"parameter": "method"}))),
        (
            r#"{"method":"io.sward.Station.SetMix","parameters":{"name":"fern","mix":-2}}"#,
            json!({"error": "io.sward.Station.InvalidMix", "parameters": {"mix": -2.0}}),
        ),
    ] {
        assert_eq!(error(message), expected);
    }
    let info = error(r#"{"method":"org.varlink.service.GetInfo"}"#);
    assert_eq!(info["parameters"]["interfaces"], json!(["org.varlink.service", "io.sward.Station"]));
    let described = error(
        r#"{"method":"org.varlink.service.GetInterfaceDescription","parameters":{"interface":"org.varlink.service"}}"#,
    );
    assert!(
        described["parameters"]["description"].as_str().is_some_and(|text| text.contains("method GetInfo"))
    );
    // Without a reply, and done nevertheless.
    station
        .send(br#"{"method":"io.sward.Station.SetMix","parameters":{"name":"fern","mix":7},"oneway":true}"#)
        .expect("it reads");
    let listed = station.call("ListBlades", &json!({})).0;
    assert_eq!(listed["parameters"]["blades"][0]["mix"], json!(7.0));
}

#[test]
fn what_is_no_message_is_answered_and_the_connection_closed() {
    let daemon = with_fern(&[]);
    for nonsense in [&b"GET / HTTP/1.1\r\n\r\n"[..], b"[1, 2]", b"", b"\xff\xfe", b"{\"method\":"] {
        let mut station = daemon.connect();
        station.send(nonsense).expect("it reads");
        let answer = station.reply().expect("it answers").0;
        assert_eq!(answer["error"], "io.sward.Station.NotAMessage", "{answer}");
        assert!(station.reply().is_err(), "it hangs up");
    }
    assert_eq!(daemon.connect().status()["store"], "ok");
}

/// Reads what the station answers, until it has nothing more to say or waits for a library.
fn hear_out(mut stream: UnixStream) {
    stream.set_read_timeout(Some(Duration::from_millis(50))).expect("a socket has a timeout");
    let _ = stream.read_to_end(&mut Vec::new());
}

#[test]
fn nothing_that_a_client_sends_stops_the_station() {
    let daemon = with_fern(&[]);
    let messages = [
        r#"{"method":"org.varlink.service.GetInfo"}"#,
        r#"{"method":"org.varlink.service.GetInterfaceDescription","parameters":{"interface":"io.sward.Station"}}"#,
        r#"{"method":"io.sward.Station.GetLibrary","parameters":{"after":0}}"#,
        r#"{"method":"io.sward.Station.GetPreview","parameters":{"after":0}}"#,
        r#"{"method":"io.sward.Station.GetStatus","parameters":{},"more":true}"#,
        r#"{"method":"io.sward.Station.ListBlades"}"#,
        r#"{"method":"io.sward.Station.SetMix","parameters":{"name":"fern","mix":1.5}}"#,
        r#"{"method":"io.sward.Station.RenameBlade","parameters":{"name":"fern","new_name":"moss"}}"#,
        r#"{"method":"io.sward.Station.RestoreBlade","parameters":{"name":"moss"},"oneway":true}"#,
        r#"{"method":"io.sward.Station.RestoreBlade","parameters":{"name":"fern","back":2}}"#,
        r#"{"method":"io.sward.Station.ListHistory","parameters":{"name":"fern"}}"#,
        r#"{"method":"io.sward.Station.ListRemoved"}"#,
        r#"{"method":"io.sward.Station.Reload"}"#,
    ];
    let evil = [
        "0",
        "-1",
        "1e400",
        "null",
        "[]",
        "{}",
        "\"\"",
        "9223372036854775808",
        "true",
        "\"\\u0000\"",
        "\"../../x\"",
    ];
    let mut random = Random::new(4);
    let mut stream = UnixStream::connect(daemon.socket()).expect("it listens");
    for round in 0..2000 {
        let mut message = messages[random.below(messages.len())].as_bytes().to_vec();
        for _ in 0..1 + random.below(3) {
            let at = random.below(message.len());
            match random.below(5) {
                0 => message[at] = random.below(256) as u8,
                1 => message.truncate(at.max(1)),
                2 => drop(message.remove(at.min(message.len() - 1))),
                3 => {
                    let part = message[random.below(message.len())..].to_vec();
                    message.extend(part);
                }
                _ => {
                    // What stands behind some colon.
                    let colons: Vec<usize> = message
                        .iter()
                        .enumerate()
                        .filter(|(_, byte)| **byte == b':')
                        .map(|(at, _)| at)
                        .collect();
                    if let Some(colon) = colons.get(random.below(colons.len().max(1))) {
                        let end = message[*colon..].iter().position(|byte| b",}".contains(byte));
                        let end = end.map_or(message.len(), |end| colon + end);
                        message.splice(colon + 1..end, evil[random.below(evil.len())].bytes());
                    }
                }
            }
            if message.is_empty() {
                message.push(b'{');
            }
        }
        message.push(0);
        // What is no JSON ends a connection; then there is another.
        if stream.write_all(&message).is_err() || round % 20 == 19 {
            hear_out(stream);
            stream = UnixStream::connect(daemon.socket()).expect("it listens");
        }
    }
    let mut station = daemon.connect();
    assert_eq!(station.status()["store"], "ok", "it still answers");
    let names: Vec<String> = station.library(0).blades().map(|blade| blade.name().to_owned()).collect();
    // Some of them give it another name, and none takes it away.
    assert_eq!(names.len(), 1, "{names:?}");
    let (_, finished) = daemon.end();
    assert_eq!(finished.code, Some(0), "{finished:?}");
    assert!(!finished.stderr.contains("panicked"), "{}", finished.stderr);
}

#[test]
fn descriptors_that_a_client_sends_are_closed() {
    let mut daemon = with_fern(&[]);
    let process = format!("/proc/{}/fd", daemon.running().id());
    let open = || fs::read_dir(&process).expect("it runs").count();
    let stream = UnixStream::connect(daemon.socket()).expect("it listens");
    let before = open();
    let file = fs::File::open("/dev/null").expect("it is there");
    let descriptors = [file.as_fd(); 8];
    for _ in 0..100 {
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(8))];
        let mut ancillary = SendAncillaryBuffer::new(&mut space);
        assert!(ancillary.push(SendAncillaryMessage::ScmRights(&descriptors)));
        // A message that is never ended.
        sendmsg(&stream, &[IoSlice::new(b" ")], &mut ancillary, SendFlags::empty()).expect("it reads");
    }
    assert_eq!(daemon.connect().status()["store"], "ok");
    wait_for(DEADLINE, || (open() <= before + 2).then_some(())).expect("they are closed");
}

#[test]
fn a_message_without_an_end_is_not_read_for_ever() {
    let daemon = with_fern(&[]);
    let mut stream = UnixStream::connect(daemon.socket()).expect("it listens");
    let kilobyte = [b' '; 1024];
    let sent = (0..10_000).take_while(|_| stream.write_all(&kilobyte).is_ok()).count();
    assert!(sent < 1000, "{sent} kilobytes of one message were read");
    let mut told = Vec::new();
    let _ = stream.read_to_end(&mut told);
    let told = String::from_utf8_lossy(&told);
    assert!(
        told.starts_with("{\"error\":\"io.sward.Station.MessageTooLong\"") && told.contains("65536"),
        "{told}"
    );
    assert_eq!(daemon.connect().status()["blades"], json!(1));
}

#[test]
fn readers_that_do_not_read_hold_up_nobody() {
    let daemon = with_fern(&[]);
    let mut lazy: Vec<UnixStream> =
        (0..20).map(|_| UnixStream::connect(daemon.socket()).expect("it listens")).collect();
    let call = b"{\"method\":\"org.varlink.service.GetInterfaceDescription\",\"parameters\":{\"interface\":\"io.sward.Station\"}}\0";
    for stream in &mut lazy {
        stream.set_write_timeout(Some(Duration::from_millis(50))).expect("a socket has a timeout");
        // Until neither side takes anything any more.
        while stream.write_all(call).is_ok() {}
    }
    let mut station = daemon.connect();
    for mix in [2.0, 3.0, 4.0] {
        let before = station.library(0).generation();
        assert_eq!(station.call("SetMix", &json!({"name": "fern", "mix": mix})).0, json!({}));
        let library = station.library(before);
        assert_eq!(library.blades().next().expect("fern").mix(), mix as f32);
    }
    let mut one = lazy.pop().expect("20 of them");
    let mut reply = [0; 64];
    one.read_exact(&mut reply).expect("what was answered is there");
    assert!(reply.starts_with(b"{\"parameters\":{\"description\":"), "{}", String::from_utf8_lossy(&reply));
}

#[test]
fn a_hundred_readers_are_served_and_more_than_the_limit_are_turned_away() {
    let mut daemon = with_fern(&[("service.max_connections", "110".to_owned())]);
    let mut readers: Vec<_> = (0..100).map(|_| daemon.connect()).collect();
    let first = readers[0].library(0).generation();
    let waiting: Vec<_> = readers
        .drain(..)
        .map(|mut reader| std::thread::spawn(move || (reader.library(first).generation(), reader)))
        .collect();
    assert_eq!(daemon.connect().call("SetMix", &json!({"name": "fern", "mix": 3})).0, json!({}));
    let (generations, readers): (Vec<u64>, Vec<_>) =
        waiting.into_iter().map(|reader| reader.join().expect("it gets its library")).unzip();
    assert!(generations.iter().all(|generation| *generation > first), "{generations:?}");

    let mut more: Vec<_> = (0..20).map(|_| daemon.connect()).collect();
    let ask = |station: &mut tests::station::Station| {
        let answer = station.try_ask("io.sward.Station.GetStatus", &json!({}));
        answer.is_ok_and(|(reply, _)| reply["error"].is_null())
    };
    let served = more.iter_mut().map(ask).filter(|served| *served).count();
    assert!((8..=10).contains(&served), "{served} of 20 on top of 100, where 110 may be");
    // Places that were left a moment ago are free only now.
    std::thread::sleep(Duration::from_millis(500));
    more.extend((0..3).map(|_| daemon.connect()));
    // Who finds no place is told so, whether it asks first or reads first, and a flood of such costs nothing.
    let full = json!({"error": "io.sward.Station.TooManyConnections", "parameters": {"limit": 110}});
    let mut one_more = daemon.connect();
    let told = one_more.try_ask("io.sward.Station.GetStatus", &json!({})).expect("it is told");
    assert_eq!(told.0, full);
    let mut silent = daemon.connect();
    assert_eq!(silent.reply().expect("it is told").0, full);
    let refused_now = daemon.client(&["status"]);
    refused(&refused_now, 1, &["110", "service.max_connections"]);
    let process = format!("/proc/{}/fd", daemon.running().id());
    let open = || fs::read_dir(&process).expect("it runs").count();
    let before = open();
    let flood: Vec<_> = (0..2000).filter_map(|_| UnixStream::connect(daemon.socket()).ok()).collect();
    let mut told = 0;
    for mut stream in flood {
        let mut reply = Vec::new();
        // One that was closed while it wrote nothing still holds what it was told.
        let _ = stream.read_to_end(&mut reply);
        told += usize::from(reply.starts_with(b"{\"error\":\"io.sward.Station.TooManyConnections\""));
    }
    assert!(told > 1900, "{told} of 2000 were told");
    wait_for(DEADLINE, || (open() <= before + 2).then_some(())).expect("they are closed");
    drop((readers, more));
    wait_for(DEADLINE, || ask(&mut daemon.connect()).then_some(())).expect("there is room again");
}

#[test]
fn many_libraries_and_many_readers_leave_nothing_behind() {
    // Frames take memory too: they are over.
    let mut daemon = with_fern(&[("source.loop", "false".to_owned()), ("source.rate", "0.0".to_owned())]);
    wait_for(DEADLINE, || {
        let (reply, _) = daemon.connect().call("Capture", &json!({}));
        (reply["error"] == "io.sward.Station.NoFrames").then_some(())
    })
    .expect("the recording comes to its end");
    let process = format!("/proc/{}", daemon.running().id());
    let descriptors = || fs::read_dir(format!("{process}/fd")).expect("it runs").count();
    let kilobytes = || {
        let status = fs::read_to_string(format!("{process}/status")).expect("it runs");
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("its memory");
        line.trim().trim_end_matches(" kB").parse::<u64>().expect("a number")
    };
    let publish = |count: u32| {
        let mut station = daemon.connect();
        let mut after = 0;
        for number in 0..count {
            let mix = json!({"name": "fern", "mix": number % 7});
            assert_eq!(station.call("SetMix", &mix).0, json!({}));
            after = station.library(after).generation();
            // A reader that leaves while it waits.
            let mut waiting = daemon.connect();
            let call = json!({"method": "io.sward.Station.GetLibrary", "parameters": {"after": after}});
            waiting.send(call.to_string().as_bytes()).expect("it reads");
        }
    };
    publish(100);
    let (few, before) = (descriptors(), kilobytes());
    publish(400);
    let flat = wait_for(DEADLINE, || (descriptors() <= few).then_some(()));
    assert!(flat.is_some(), "{} descriptors, {few} before", descriptors());
    assert!(kilobytes() < before + 4096, "{} kB, {before} kB before", kilobytes());
}
