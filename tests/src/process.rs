//! What the system says of a process that runs.

use std::fs;
use std::path::PathBuf;
use std::time::Duration;

/// A process by its id, as `/proc` shows it.
#[derive(Clone, Copy, Debug)]
pub struct Process(pub u32);

impl Process {
    fn file(self, name: &str) -> PathBuf {
        PathBuf::from(format!("/proc/{}/{name}", self.0))
    }

    /// Memory of it that is resident, KiB.
    ///
    /// # Panics
    /// If it has ended.
    pub fn resident_kib(self) -> u64 {
        let status = fs::read_to_string(self.file("status")).expect("it runs");
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("its memory");
        line.trim().trim_end_matches(" kB").parse().expect("a number")
    }

    /// Number of its open descriptors.
    ///
    /// # Panics
    /// If it has ended.
    pub fn descriptors(self) -> usize {
        fs::read_dir(self.file("fd")).expect("it runs").count()
    }

    /// Time on a processor so far, its own and the system's for it, of all threads; in steps of a
    /// clock tick.
    ///
    /// # Panics
    /// If it has ended.
    pub fn processor_time(self) -> Duration {
        let stat = fs::read_to_string(self.file("stat")).expect("it runs");
        // The name may hold spaces; behind its bracket the state is the third field.
        let (_, fields) = stat.rsplit_once(')').expect("a name in brackets");
        let fields: Vec<&str> = fields.split_ascii_whitespace().collect();
        let ticks: u64 = fields[11..13].iter().map(|field| field.parse::<u64>().expect("a number")).sum();
        let per_second = rustix::param::clock_ticks_per_second();
        Duration::from_secs_f64(ticks as f64 / per_second as f64)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;

    #[test]
    fn a_process_at_work_takes_time_memory_and_descriptors() {
        let process = Process(std::process::id());
        let before = (process.processor_time(), process.resident_kib(), process.descriptors());
        // Other tests of this program open and close a few meanwhile.
        let files: Vec<_> = (0..64).map(|_| fs::File::open("/dev/null").expect("it is there")).collect();
        let memory = std::hint::black_box(vec![1u8; 64 << 20]);
        let start = Instant::now();
        while process.processor_time() < before.0 + Duration::from_millis(50) {
            assert!(start.elapsed() < crate::programs::DEADLINE, "it works, and no time is counted");
        }
        assert!(process.resident_kib() > before.1 + (32 << 10));
        assert!(process.descriptors() > before.2 + 32);
        drop((memory, files));
    }
}
