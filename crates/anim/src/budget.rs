//! How much memory a file may take.

use std::cell::{Cell, RefCell};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

use crate::error::Problem;

/// Bytes that may be taken however small the file is.
const FREE_BYTES: u64 = 1 << 30;
/// Bytes allowed for every byte of the file and of those that it names, each counted once.
pub(crate) const BYTES_PER_BYTE: u64 = 256;
/// Bytes of a vertex and of a triangle in a whole program that shows them: positions, normals and
/// their copies; the tree, its primitives and its builder.
const BYTES_PER_VERTEX: u64 = 100;
const BYTES_PER_TRIANGLE: u64 = 120;

/// The bytes that may be taken, and those taken so far. Instancing, includes and accessors without
/// bytes let a small file declare any amount of geometry, so memory is limited to a multiple of the
/// size of the input.
#[derive(Default)]
pub(crate) struct Budget {
    spent: Cell<u64>,
    /// The files of the input, and the sum of their bytes.
    files: RefCell<HashSet<PathBuf>>,
    input: Cell<u64>,
}

impl Budget {
    /// Allows for the bytes of a file of the input, unless it counts already.
    pub(crate) fn allow_for(&self, file: &Path, bytes: usize) {
        if self.files.borrow_mut().insert(file.to_owned()) {
            self.input.set(self.input.get().saturating_add(bytes as u64));
        }
    }

    fn limit(&self) -> u64 {
        self.input.get().saturating_mul(BYTES_PER_BYTE).saturating_add(FREE_BYTES).min(isize::MAX as u64)
    }

    pub(crate) fn left(&self) -> u64 {
        self.limit() - self.spent.get()
    }

    pub(crate) fn spend(&self, bytes: u64, place: &str) -> Result<(), Problem> {
        self.check(bytes, place).map(|spent| self.spent.set(spent))
    }

    /// The sum if these bytes were taken, which they must be able to be.
    pub(crate) fn check(&self, bytes: u64, place: &str) -> Result<u64, Problem> {
        let (spent, limit) = (self.spent.get().saturating_add(bytes), self.limit());
        if spent > limit {
            let expected = format!("at most {limit} for files of this size");
            return Err(Problem::new(place, format!("{spent} bytes of decoded data in all"), expected));
        }
        Ok(spent)
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
