//! Files of the profile that have changed on disk. The program that has loaded the profile compares the files
//! on disk with the loaded files. The status contains the names of the changed files.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Names of the files of the profile that differ from those that the gateway has loaded.
#[derive(Debug, Default)]
pub struct ProfileChanges(Mutex<Vec<String>>);

impl ProfileChanges {
    /// Returns the names of the files, variables and options that differ at present.
    pub fn read(&self) -> Vec<String> {
        self.get().clone()
    }

    /// Replaces the stored names by the result of the last comparison.
    pub fn note(&self, files: Vec<String>) {
        *self.get() = files;
    }

    fn get(&self) -> MutexGuard<'_, Vec<String>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
