//! The station that runs, by what it says of itself.

use common::protocol::Status;

use super::Finding;

/// One frame in so many may be dropped or skipped.
const RARELY: i64 = 100;

/// Its version, its frames, its store.
pub(super) fn examine(status: &Status) -> Vec<Finding> {
    vec![version(status), frames(status), store(status)]
}

fn version(status: &Status) -> Finding {
    const CHECK: &str = "station.version";
    let own = env!("CARGO_PKG_VERSION");
    if status.version == own {
        return Finding::ok(CHECK, "", own);
    }
    let remedy = "start the station anew, or use the program that it was started from";
    Finding::trouble(
        CHECK,
        "",
        format!("the station is {}", status.version),
        format!("{own}, as this program"),
        remedy,
    )
}

fn frames(status: &Status) -> Finding {
    const CHECK: &str = "station.frames";
    let Status { source, frames, dropped_frames, skipped_frames, frames_per_second, .. } = status;
    let found = format!(
        "{frames_per_second:.1} a second; {frames} seen, {dropped_frames} dropped, {skipped_frames} skipped since the start"
    );
    let seldom = |count: i64| count.saturating_mul(RARELY) <= *frames;
    if source == "none" {
        let remedy = "set source.recording to a recording and start the station anew";
        let found = "the station has no source, and will never capture anything";
        return Finding::trouble(CHECK, "source.recording", found, "a source of frames", remedy);
    }
    if *frames_per_second <= 0.0 {
        let remedy =
            "see its log; where the recording is over, set source.loop = true or start the station anew";
        return Finding::trouble(CHECK, source, format!("no frames come: {found}"), "frames", remedy);
    }
    if !seldom(*dropped_frames) {
        let remedy = "see what else runs on this machine, lower source.rate, or set mask.roi";
        return Finding::trouble(CHECK, source, found, format!("fewer than 1 in {RARELY} dropped"), remedy);
    }
    if !seldom(*skipped_frames) {
        let remedy = "see its log for the reason, and sward-capture info for the recording's damage";
        return Finding::trouble(CHECK, source, found, format!("fewer than 1 in {RARELY} skipped"), remedy);
    }
    Finding::ok(CHECK, source, found)
}

fn store(status: &Status) -> Finding {
    const CHECK: &str = "station.store";
    let Status { store, waiting, lost, blades, generation, .. } = status;
    if store != "ok" || *waiting > 0 {
        let found = format!("it cannot be written: {store}; {waiting} captured blades wait");
        let remedy = "make room or mend the disk; it goes on by itself then";
        return Finding::trouble(CHECK, "", found, "a store that can be written", remedy);
    }
    if *lost > 0 {
        let found = format!("{lost} captured blades were lost since the start: there was no room for them");
        let remedy = "see the log for when that was; starting the station anew sets this count to 0";
        return Finding::trouble(CHECK, "", found, "no lost blades", remedy);
    }
    Finding::ok(CHECK, "", format!("{blades} blades in the library, generation {generation}"))
}

#[cfg(test)]
mod tests {
    use super::super::Verdict;
    use super::super::tests::assert_trouble;
    use super::*;

    fn well() -> Status {
        Status {
            blades: 3,
            frames: 1000,
            skipped_frames: 2,
            dropped_frames: 10,
            frames_per_second: 30.0,
            ..Status::at_start("a recording", "0", env!("CARGO_PKG_VERSION"))
        }
    }

    #[test]
    fn a_station_that_does_well_is_no_trouble() {
        let found = examine(&well());
        assert!(found.iter().all(|finding| finding.verdict == Verdict::Ok), "{found:?}");
        assert!(found[1].found.contains("30.0 a second"), "{found:?}");
        let idle = Status { source: "none".to_owned(), frames_per_second: 0.0, ..well() };
        assert_trouble(&examine(&idle)[1], &["source.recording", "never capture anything"]);
    }

    #[test]
    fn what_is_wrong_with_a_station_is_said() {
        let with = |change: fn(&mut Status)| {
            let mut status = well();
            change(&mut status);
            examine(&status)
        };
        assert_trouble(
            &with(|status| status.version = "0.0.1".to_owned())[0],
            &["0.0.1", "start the station anew"],
        );
        assert_trouble(&with(|status| status.frames_per_second = 0.0)[1], &["no frames come", "source.loop"]);
        assert_trouble(&with(|status| status.dropped_frames = 11)[1], &["11 dropped", "mask.roi"]);
        assert_trouble(&with(|status| status.skipped_frames = 11)[1], &["11 skipped", "log"]);
        assert_trouble(&with(|status| status.store = "no space left".to_owned())[2], &["no space left"]);
        assert_trouble(&with(|status| status.waiting = 2)[2], &["2 captured blades wait"]);
        assert_trouble(&with(|status| status.lost = 1)[2], &["1 captured blades were lost"]);
    }
}
