//! Recorded simulations, and the cache of them on disk.
//!
//! A file is: magic, source hash of this crate, the scene with its parameters as text, the measures, the
//! arrays, and an XXH3 checksum of all before it; little-endian. Whatever does not match in every part
//! is simulated again and overwritten.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use xxhash_rust::xxh3::xxh3_64;

use crate::{Measure, SceneOptions};

const MAGIC: &[u8; 8] = b"PIVOTKEY";
const SOURCE_HASH: &str = env!("SCENES_SOURCE_HASH");

/// What a simulation leaves behind: arrays of its own layout, and its errors.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Record {
    pub(crate) floats: Vec<Vec<f32>>,
    pub(crate) ints: Vec<Vec<u32>>,
    pub(crate) measures: Vec<Measure>,
}

/// The record of `simulate` from the cache, or fresh, and then written to the cache.
///
/// `parameters` names the scene and every option that `simulate` depends on. A note is pushed if the cache
/// cannot be written.
pub(crate) fn recorded(
    parameters: &str,
    options: &SceneOptions<'_>,
    notes: &mut Vec<String>,
    simulate: impl FnOnce() -> Record,
) -> Record {
    let Some(dir) = &options.cache_dir else {
        return simulate();
    };
    let path = cache_path(dir, parameters);
    if let Some(record) = fs::read(&path).ok().and_then(|bytes| decode(&bytes, parameters)) {
        return record;
    }
    let record = simulate();
    if let Err(error) = write_whole(dir, &path, &encode(&record, parameters)) {
        notes.push(format!("key frames could not be cached at {}: {error}", path.display()));
    }
    record
}

fn cache_path(dir: &Path, parameters: &str) -> PathBuf {
    let scene = parameters.split_whitespace().next().unwrap_or("scene");
    dir.join(format!("{scene}-{:016x}.keys", xxh3_64(parameters.as_bytes())))
}

/// Writes under a name that no other writer uses and renames, so that no reader ever sees half a file, not even after the
/// power has failed.
fn write_whole(dir: &Path, path: &Path, bytes: &[u8]) -> io::Result<()> {
    static WRITES: AtomicUsize = AtomicUsize::new(0);
    fs::create_dir_all(dir)?;
    let number = WRITES.fetch_add(1, Ordering::Relaxed);
    let temporary = path.with_extension(format!("{}-{number}.tmp", std::process::id()));
    let write = || {
        let mut file = File::create(&temporary)?;
        file.write_all(bytes)?;
        // Some file systems say as late as this that the disk is full.
        file.sync_all()?;
        fs::rename(&temporary, path)
    };
    write().inspect_err(|_| {
        // The error that is reported is the first one; a leftover temporary file harms nobody.
        let _ = fs::remove_file(&temporary);
    })
}

fn encode(record: &Record, parameters: &str) -> Vec<u8> {
    let mut out = MAGIC.to_vec();
    put(&mut out, SOURCE_HASH.as_bytes());
    put(&mut out, parameters.as_bytes());
    out.extend((record.measures.len() as u64).to_le_bytes());
    for measure in &record.measures {
        put(&mut out, measure.name.as_bytes());
        out.extend(measure.value.to_le_bytes());
    }
    out.extend((record.floats.len() as u64).to_le_bytes());
    for array in &record.floats {
        put(&mut out, bytemuck::cast_slice(array));
    }
    out.extend((record.ints.len() as u64).to_le_bytes());
    for array in &record.ints {
        put(&mut out, bytemuck::cast_slice(array));
    }
    let checksum = xxh3_64(&out);
    out.extend(checksum.to_le_bytes());
    out
}

fn put(out: &mut Vec<u8>, bytes: &[u8]) {
    out.extend((bytes.len() as u64).to_le_bytes());
    out.extend(bytes);
}

fn decode(bytes: &[u8], parameters: &str) -> Option<Record> {
    let (mut rest, checksum) = bytes.split_last_chunk::<8>()?;
    if xxh3_64(rest) != u64::from_le_bytes(*checksum) || take(&mut rest, 8)? != MAGIC {
        return None;
    }
    if block(&mut rest)? != SOURCE_HASH.as_bytes() || block(&mut rest)? != parameters.as_bytes() {
        return None;
    }
    let mut record = Record::default();
    for _ in 0..number(&mut rest)? {
        let name = String::from_utf8(block(&mut rest)?.to_vec()).ok()?;
        let value = f64::from_le_bytes(take(&mut rest, 8)?.try_into().ok()?);
        record.measures.push(Measure { name, value });
    }
    for _ in 0..number(&mut rest)? {
        record.floats.push(words(block(&mut rest)?, f32::from_le_bytes)?);
    }
    for _ in 0..number(&mut rest)? {
        record.ints.push(words(block(&mut rest)?, u32::from_le_bytes)?);
    }
    rest.is_empty().then_some(record)
}

fn words<T>(bytes: &[u8], word: impl Fn([u8; 4]) -> T) -> Option<Vec<T>> {
    let (words, rest) = bytes.as_chunks::<4>();
    rest.is_empty().then(|| words.iter().map(|&w| word(w)).collect())
}

fn block<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    let length = usize::try_from(number(rest)?).ok()?;
    take(rest, length)
}

fn number(rest: &mut &[u8]) -> Option<u64> {
    Some(u64::from_le_bytes(take(rest, 8)?.try_into().ok()?))
}

fn take<'a>(rest: &mut &'a [u8], length: usize) -> Option<&'a [u8]> {
    rest.split_off(..length)
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    fn sample() -> Record {
        Record {
            floats: vec![vec![1.0, -2.5], vec![]],
            ints: vec![vec![7; 100]],
            measures: vec![Measure { name: "drift".to_owned(), value: 1e-3 }],
        }
    }

    #[test]
    fn decode_gives_back_what_was_encoded_and_rejects_every_damage() {
        let bytes = encode(&sample(), "test 1");
        assert_eq!(decode(&bytes, "test 1"), Some(sample()));
        assert_eq!(decode(&bytes, "test 2"), None, "other parameters");
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0x10;
            assert_eq!(decode(&damaged, "test 1"), None, "byte {at} flipped");
            assert_eq!(decode(&bytes[..at], "test 1"), None, "cut at {at}");
        }
    }

    #[test]
    fn damaged_cache_is_rebuilt_and_a_good_one_is_used() {
        let dir = std::env::temp_dir().join(format!("pivot-cache-test-{}", std::process::id()));
        let options = SceneOptions { cache_dir: Some(dir.clone()), ..SceneOptions::default() };
        let runs = Cell::new(0);
        let mut notes = Vec::new();
        let mut get = || {
            let record = recorded("test 1", &options, &mut notes, || {
                runs.set(runs.get() + 1);
                sample()
            });
            assert_eq!(record, sample());
        };
        get();
        get();
        assert_eq!(runs.get(), 1, "the second came from the cache");
        let path = cache_path(&dir, "test 1");
        let mut bytes = fs::read(&path).unwrap();
        bytes[40] ^= 1;
        fs::write(&path, bytes).unwrap();
        get();
        get();
        assert_eq!(runs.get(), 2, "the damaged file was made again, once");
        assert_eq!(fs::read_dir(&dir).unwrap().count(), 1, "no temporary files are left");
        assert!(notes.is_empty());
        fs::remove_dir_all(dir).unwrap();
    }

    #[test]
    fn cache_that_cannot_be_written_is_noted() {
        let file = std::env::temp_dir().join(format!("pivot-cache-file-{}", std::process::id()));
        fs::write(&file, "not a folder").unwrap();
        let options = SceneOptions { cache_dir: Some(file.clone()), ..SceneOptions::default() };
        let mut notes = Vec::new();
        assert_eq!(recorded("test 1", &options, &mut notes, sample), sample());
        assert_eq!(notes.len(), 1);
        fs::remove_file(file).unwrap();
    }
}
