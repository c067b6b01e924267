//! Does a queue that is full hold up nobody, and is what is missing counted and said?

use std::time::Instant;

use super::*;
use crate::bar;
use crate::recording::{self, OpenOptions};
use crate::session::SessionParams;
use crate::source::SourceError;

const ALL: Limits = Limits { reserve_bytes: 0, max_bytes: u64::MAX, max_age: None };

fn settings(folder: &std::path::Path) -> Settings {
    Settings {
        target: Target::Folder(folder.to_owned()),
        limits: ALL,
        file_span: Duration::from_secs(600),
        is_always: true,
        ring: None,
        save_on: Vec::new(),
        config: String::new(),
    }
}

/// Frames that show something held from the tenth on, through a session and the recorder.
fn push(recorder: &mut Recorder, session: &mut Session, indices: std::ops::Range<u64>) -> usize {
    let mut captures = 0;
    for index in indices {
        let frame = Arc::new(bar::frame(index, (index >= 10).then_some(500), 1300));
        recorder.frame(&frame, session);
        captures += usize::from(session.push(&frame).is_some());
    }
    captures
}

/// The recordings in a folder, in any order.
fn files(folder: &std::path::Path) -> Vec<PathBuf> {
    let files = std::fs::read_dir(folder).expect("a folder").flatten().map(|entry| entry.path());
    files.filter(|path| path.is_file()).collect()
}

/// Runs all frames that `push` gives through a recorder, and waits for what is written.
fn recorded(settings: Settings, push: impl FnOnce(&mut Recorder)) -> Told {
    let (mut recorder, inbox) = queue(true);
    let (tell, told) = watch::channel(Told::default());
    let work = Work::new(settings, "a bar", inbox, tell);
    let thread = std::thread::spawn(move || work.run());
    push(&mut recorder);
    recorder.jobs().send(Job::End).expect("it listens");
    thread.join().expect("it ends");
    told.borrow().clone()
}

/// Times of the captures in a replay.
fn captures(path: &std::path::Path) -> Vec<u64> {
    let mut source = recording::open(path, &OpenOptions::default()).expect("a recording");
    let mut session = Session::new(SessionParams::default());
    let mut captures = Vec::new();
    loop {
        match source.next_frame() {
            Ok(frame) => captures.extend(session.push(&frame).map(|capture| capture.timestamp_ns)),
            Err(SourceError::Told(note)) => session.take_note(&note),
            Err(SourceError::End) => return captures,
            Err(error) => panic!("{error}"),
        }
    }
}

/// Frames and notes of the only recording in a folder.
fn read(folder: &std::path::Path) -> (Vec<u64>, Vec<Note>) {
    let mut files = files(folder);
    assert_eq!(files.len(), 1, "{files:?}");
    let mut source =
        recording::open(&files.pop().expect("one"), &OpenOptions::default()).expect("a recording");
    let (mut times, mut notes) = (Vec::new(), Vec::new());
    loop {
        match source.next_frame() {
            Ok(frame) => times.push(frame.timestamp_ns),
            Err(SourceError::Told(note)) => notes.push(note),
            Err(SourceError::End) => return (times, notes),
            Err(error) => panic!("{error}"),
        }
    }
}

#[test]
fn a_writer_that_hangs_holds_up_nobody_and_what_is_missing_is_counted_and_said() {
    let folder = tempfile::tempdir().expect("a folder");
    let (mut recorder, inbox) = queue(false);
    let (tell, told) = watch::channel(Told::default());
    let work = Work::new(settings(folder.path()), "a bar", inbox, tell);
    let mut session = Session::new(SessionParams::default());
    // Nobody writes yet: 64 find room, the others do not.
    assert_eq!(push(&mut recorder, &mut session, 0..100), 1, "the session goes on");
    let thread = std::thread::spawn(move || work.run());
    let start = Instant::now();
    while told.borrow().frames < 64 {
        assert!(start.elapsed() < Duration::from_secs(60), "{:?}", *told.borrow());
        std::thread::sleep(Duration::from_millis(5));
    }
    push(&mut recorder, &mut session, 100..110);
    recorder.jobs().send(Job::End).expect("it listens");
    thread.join().expect("it ends");
    assert_eq!((told.borrow().slow_frames, told.borrow().frames), (36, 74));
    let (times, notes) = read(folder.path());
    let expected = (0..64).chain(100..110).map(|index| bar::frame(index, None, 1300).timestamp_ns);
    assert_eq!(times, expected.collect::<Vec<_>>());
    assert_eq!(notes, [Note::Begins { captured: false }, Note::Dropped { frames: 36 }]);
}

#[test]
fn a_recording_that_is_to_begin_in_the_midst_of_a_hold_begins_it_anew() {
    let folder = tempfile::tempdir().expect("a folder");
    let (mut recorder, inbox) = queue(false);
    let (tell, _told) = watch::channel(Told::default());
    let mut settings = settings(folder.path());
    settings.is_always = false;
    let work = Work::new(settings, "a bar", inbox, tell);
    let mut session = Session::new(SessionParams::default());
    assert_eq!(push(&mut recorder, &mut session, 0..15), 0);
    assert!(session.checkpoint().is_none(), "the hold runs");
    let thread = std::thread::spawn(move || work.run());
    let (reply, started) = oneshot::channel();
    recorder.jobs().send(Job::Start(reply)).expect("it listens");
    started.blocking_recv().expect("it answers").expect("there is room");
    assert_eq!(push(&mut recorder, &mut session, 15..50), 1);
    let (reply, stopped) = oneshot::channel();
    recorder.jobs().send(Job::Stop(reply)).expect("it listens");
    let end = stopped.blocking_recv().expect("it answers").expect("it is written");
    assert_eq!(end.frames, 35);
    recorder.jobs().send(Job::End).expect("it listens");
    thread.join().expect("it ends");
    let (times, notes) = read(folder.path());
    assert_eq!((times.len(), notes), (35, vec![Note::Begins { captured: false }]));
}

#[test]
fn a_recording_goes_on_in_other_files_and_each_is_a_recording_by_itself() {
    let folder = tempfile::tempdir().expect("a folder");
    let settings = Settings { file_span: Duration::ZERO, ..settings(folder.path()) };
    let mut live = Vec::new();
    let told = recorded(settings, |recorder| {
        let mut session = Session::new(SessionParams::default());
        for index in 0..60 {
            // Held, gone, and held again.
            let is_held = (5..25).contains(&index) || index >= 30;
            let frame = Arc::new(bar::frame(index, is_held.then_some(500), 1300));
            recorder.frame(&frame, &mut session);
            live.extend(session.push(&frame).map(|capture| capture.timestamp_ns));
        }
    });
    assert_eq!((live.len(), told.frames, told.trouble), (2, 60, None));
    let files = files(folder.path());
    assert!(files.len() > 10, "one at each moment when nothing is held");
    let mut replayed: Vec<u64> = files.iter().flat_map(|path| captures(path)).collect();
    replayed.sort_unstable();
    assert_eq!(replayed, live);
}

#[test]
fn frames_of_another_shape_are_another_recording() {
    let folder = tempfile::tempdir().expect("a folder");
    let told = recorded(settings(folder.path()), |recorder| {
        let mut session = Session::new(SessionParams::default());
        for index in 0..20 {
            let mut frame = bar::frame(index, None, 1300);
            if index >= 12 {
                frame.camera.fx += 1.0;
            }
            recorder.frame(&Arc::new(frame), &mut session);
        }
    });
    assert_eq!((told.frames, told.ended), (20, 2));
    let mut focal: Vec<(u32, f64)> = Vec::new();
    for path in files(folder.path()) {
        let mut source = recording::open(&path, &OpenOptions::default()).expect("a recording");
        let mut frames = 0;
        let mut last = 0.0;
        loop {
            match source.next_frame() {
                Ok(frame) => (frames, last) = (frames + 1, frame.camera.fx),
                Err(SourceError::Told(_)) => {}
                Err(_) => break,
            }
        }
        focal.push((frames, last));
    }
    focal.sort_by_key(|seen| std::cmp::Reverse(seen.0));
    assert_eq!(focal, [(12, 140.0), (8, 141.0)]);
}

#[test]
fn a_folder_that_cannot_be_made_is_said_and_costs_nothing_else() {
    let folder = tempfile::tempdir().expect("a folder");
    let nowhere = folder.path().join("no/such");
    let told = recorded(settings(&nowhere), |recorder| {
        let mut session = Session::new(SessionParams::default());
        assert_eq!(push(recorder, &mut session, 0..40), 1, "the session goes on");
    });
    assert_eq!((told.frames, told.disk_frames), (0, 40));
    assert!(told.trouble.is_some_and(|why| why.contains("record.directory")));
}
