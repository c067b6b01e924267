//! Makes libraries ready to grow on a thread of its own: the frame loop gives it a snapshot and takes the shapes
//! when they are done. Only the newest counts.

use std::sync::mpsc::{Receiver, Sender, channel};

use common::library::Snapshot;

use crate::scene::grassland::shapes::{Shapes, shapes};

/// A library that is ready to grow.
#[derive(Debug)]
pub struct Seedling {
    /// Generation of the library.
    pub generation: u64,
    /// Its shapes; `None`: nothing in it grows.
    pub shapes: Option<Shapes>,
}

/// The thread; it ends when this is dropped.
#[derive(Debug)]
pub struct Nursery<B> {
    snapshots: Sender<Snapshot<B>>,
    seedlings: Receiver<Seedling>,
}

impl<B: AsRef<[u8]> + Send + 'static> Nursery<B> {
    /// Starts the thread.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn start() -> std::io::Result<Self> {
        let (snapshots, given) = channel::<Snapshot<B>>();
        let (done, seedlings) = channel();
        std::thread::Builder::new().name("nursery".into()).spawn(move || {
            while let Ok(snapshot) = given.recv() {
                let snapshot = given.try_iter().last().unwrap_or(snapshot);
                let seedling = Seedling { generation: snapshot.generation(), shapes: shapes(&snapshot) };
                if done.send(seedling).is_err() {
                    break;
                }
            }
        })?;
        Ok(Self { snapshots, seedlings })
    }

    /// Gives it a library. Never waits.
    pub fn sow(&self, library: Snapshot<B>) {
        // The thread ends only by a panic, which is reported where it happens; the meadow keeps what it has.
        let _ = self.snapshots.send(library);
    }

    /// The newest library that is ready, if one came since the last time. Never waits.
    pub fn take(&self) -> Option<Seedling> {
        self.seedlings.try_iter().last()
    }
}
