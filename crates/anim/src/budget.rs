//! How much memory a file may take.

use std::cell::{Cell, RefCell};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

use crate::error::Problem;

/// Bytes that may be taken however small the file is.
const FREE_BYTES: u64 = 1 << 30;
/// Bytes allowed for every byte of the file and of those that it names, each counted once.
const BYTES_PER_BYTE: u64 = 256;
/// Bytes of a vertex and of a triangle in a whole program that shows them: positions, normals and
/// their copies; the tree, its primitives and its builder.
const BYTES_PER_VERTEX: u64 = 100;
const BYTES_PER_TRIANGLE: u64 = 120;

/// The bytes that may be taken, and those taken so far. Instancing, includes and accessors without
/// bytes let a small file declare any amount of geometry, so memory is limited to a multiple of the
/// size of the input.
pub(crate) struct Budget {
    limit: Cell<u64>,
    spent: Cell<u64>,
    /// Files that the limit allows for.
    files: RefCell<HashSet<PathBuf>>,
}

impl Default for Budget {
    fn default() -> Self {
        Self { limit: Cell::new(FREE_BYTES), spent: Cell::default(), files: RefCell::default() }
    }
}

impl Budget {
    /// Allows for the bytes of a file of the input, unless it counts already.
    pub(crate) fn allow_for(&self, file: &Path, bytes: usize) {
        if self.files.borrow_mut().insert(file.to_owned()) {
            let more = (bytes as u64).saturating_mul(BYTES_PER_BYTE);
            self.limit.set(self.limit.get().saturating_add(more));
        }
    }

    pub(crate) fn left(&self) -> u64 {
        self.limit.get() - self.spent.get()
    }

    pub(crate) fn spend(&self, bytes: u64, place: &str) -> Result<(), Problem> {
        let (spent, limit) = (self.spent.get().saturating_add(bytes), self.limit.get());
        if spent > limit {
            let expected = format!("at most {limit} for files of this size");
            return Err(Problem::new(place, format!("{spent} bytes of decoded data in all"), expected));
        }
        self.spent.set(spent);
        Ok(())
    }

    pub(crate) fn spend_on(&self, vertices: usize, triangles: usize, place: &str) -> Result<(), Problem> {
        self.spend(vertices as u64 * BYTES_PER_VERTEX + triangles as u64 * BYTES_PER_TRIANGLE, place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_named_twice_counts_once() {
        let budget = Budget::default();
        for (file, expected) in [("a", 1), ("b", 2), ("a", 2)] {
            budget.allow_for(Path::new(file), 1);
            assert_eq!(budget.left(), FREE_BYTES + expected * BYTES_PER_BYTE, "{file}");
        }
    }
}
