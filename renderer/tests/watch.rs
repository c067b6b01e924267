//! Does the watch follow a station over its socket: the first library, newer ones, a refused one, a
//! station that comes late, goes away and comes back?

mod common;

use std::os::fd::OwnedFd;
use std::path::Path;
use std::time::{Duration, Instant};

use renderer::library_watch::LibraryWatch;
use serde::Deserialize;
use zlink::{Call, Listener, Reply};

#[derive(Debug, Deserialize)]
#[serde(tag = "method", content = "parameters")]
enum Method {
    #[serde(rename = "io.sward.Station.GetLibrary")]
    GetLibrary { after: i64 },
}

/// Serves one connection: answers each call with the next of `snapshots`, and goes away at the call
/// after the last. Returns what each call asked for.
async fn serve(socket: &Path, snapshots: Vec<(i64, Vec<u8>)>) -> Vec<i64> {
    let mut listener = zlink::tokio::unix::bind(socket).expect("a free path");
    let mut connection = listener.accept().await.expect("a caller").expect("a connection");
    let mut asked = Vec::new();
    let mut snapshots = snapshots.into_iter();
    loop {
        let after = {
            let (call, _) = connection.receive_call::<Method>().await.expect("a call");
            let call: Call<Method> = call;
            let Method::GetLibrary { after } = call.method();
            *after
        };
        asked.push(after);
        let Some((generation, bytes)) = snapshots.next() else { break };
        let blades = if bytes.len() > 16 { i64::from(bytes[12]) } else { 0 };
        let reply = ::common::protocol::Library { generation, blades, size: bytes.len() as i64, fd: 0 };
        let descriptor: OwnedFd = ::common::sealed::seal("library", &bytes).expect("memfd");
        connection.send_reply(&Reply::new(Some(reply)), vec![descriptor]).await.expect("sent");
    }
    std::fs::remove_file(socket).expect("the socket is there");
    asked
}

fn serve_blocking(socket: &Path, snapshots: Vec<(i64, Vec<u8>)>) -> Vec<i64> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("runtime");
    runtime.block_on(serve(socket, snapshots))
}

fn soon() -> Instant {
    Instant::now() + Duration::from_secs(20)
}

#[test]
fn the_watch_follows_a_station_that_comes_and_goes() {
    let folder = tempfile::tempdir().expect("a folder");
    let socket = folder.path().join("station.sock");
    let watch = LibraryWatch::start(socket.clone()).expect("a thread");
    assert!(watch.take().is_none(), "no station yet");

    let bad = b"SWARDLIB, or so it says".to_vec();
    let first = vec![(3, common::meadow(3)), (4, bad), (9, common::library(9, &[1]))];
    let asked = serve_blocking(&socket, first);
    assert_eq!(asked, [0, 3, 4, 9], "a refused generation is not asked for again");
    let newest = watch.wait_until(soon()).expect("a library");
    assert_eq!((newest.generation(), newest.len()), (9, 1), "only the newest is kept");
    assert!(watch.take().is_none(), "taken once");

    let back = vec![(9, common::library(9, &[1])), (10, common::library(10, &[0, 2]))];
    let asked = serve_blocking(&socket, back);
    assert_eq!(asked, [0, 9, 10], "a station that is back is asked for what it has");
    let newest = watch.wait_until(soon()).expect("a library");
    assert_eq!((newest.generation(), newest.len()), (10, 2), "what is known already is no news");
    let asked = serve_blocking(&socket, vec![(2, common::library(2, &[0]))]);
    assert_eq!(asked, [0, 2]);
    let newest = watch.wait_until(soon()).expect("a library");
    assert_eq!((newest.generation(), newest.len()), (2, 1), "a station with another store begins lower");
    assert!(watch.wait_until(Instant::now()).is_none(), "a deadline is kept");
}
