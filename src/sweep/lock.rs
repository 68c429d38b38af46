//! Folder lock: one sweep at a time, with a locked file that names the holder.
//!
//! The lock is the operating system's and ends with the process. On a file system without locks the
//! file alone is used: it is respected until its process, on this host, has ended.

use super::SweepError;
use std::{
    fs::{self, File, OpenOptions, TryLockError},
    io::{Read as _, Seek as _, Write as _},
    path::Path,
    process,
};

/// Lock of a folder; released on drop.
#[derive(Debug)]
pub struct FolderLock {
    file: File,
}

impl FolderLock {
    /// Take the lock of `folder`, which exists.
    ///
    /// # Errors
    /// When another process holds it, or the file cannot be written.
    pub fn take(folder: &Path) -> Result<Self, SweepError> {
        let path = folder.join(".sweep.lock");
        let mut options = OpenOptions::new();
        let opened = options.read(true).write(true).create(true).truncate(false).open(&path);
        let mut file = opened.map_err(SweepError::io(&path, "open"))?;
        let mut holder = String::new();
        file.read_to_string(&mut holder).map_err(SweepError::io(&path, "read"))?;
        let held =
            || SweepError::Held { path: folder.to_owned(), holder: holder.trim().to_owned() };
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(held()),
            Err(TryLockError::Error(_)) if is_alive(holder.trim()) => return Err(held()),
            Err(TryLockError::Error(_)) => {}
        }
        let own = format!("process {} on {}\n", process::id(), host());
        let written = file
            .set_len(0)
            .and_then(|()| file.rewind())
            .and_then(|()| file.write_all(own.as_bytes()));
        written.map_err(SweepError::io(&path, "write"))?;
        Ok(Self { file })
    }
}

impl Drop for FolderLock {
    fn drop(&mut self) {
        // The file remains: if removed, one process could lock it while another creates it anew.
        self.file.set_len(0).ok();
    }
}

/// Return whether `process PID on HOST` may still run; one of another host always may.
fn is_alive(holder: &str) -> bool {
    let Some((pid, place)) =
        holder.strip_prefix("process ").and_then(|rest| rest.split_once(" on "))
    else {
        return false;
    };
    place != host() || Path::new("/proc").join(pid).exists()
}

/// Name of this machine.
fn host() -> String {
    let name = fs::read_to_string("/proc/sys/kernel/hostname");
    name.map_or_else(|_absent| "this machine".to_owned(), |name| name.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_second_is_told_who_is_first_and_may_follow() {
        let dir = tempfile::tempdir().unwrap();
        let first = FolderLock::take(dir.path()).unwrap();
        let refused = FolderLock::take(dir.path()).unwrap_err().to_string();
        assert!(refused.contains(&format!("process {} on ", process::id())), "{refused}");
        drop(first);
        FolderLock::take(dir.path()).unwrap();
    }

    #[test]
    fn a_process_that_is_gone_holds_nothing() {
        assert!(is_alive(&format!("process {} on {}", process::id(), host())));
        assert!(!is_alive(&format!("process 999999999 on {}", host())));
        assert!(is_alive("process 1 on elsewhere"));
        assert!(!is_alive(""));
    }
}
