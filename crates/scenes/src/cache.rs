//! Recorded simulations, and the cache of them on disk.
//!
//! A file holds the source hash of this crate, the scene with its parameters as text, and the
//! record, in the format of `postcard`, and behind them their XXH3 checksum. What does not match in
//! every part is simulated again and overwritten.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use crate::whole_file::{PARTIAL, write_whole};
use crate::{Effects, Measure, SceneOptions, SimulationStats};

const SOURCE_HASH: &str = env!("SCENES_SOURCE_HASH");

/// What a simulation leaves behind: what its scene plays back, and its errors.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Record<T> {
    pub(crate) data: T,
    pub(crate) measures: Vec<Measure>,
    pub(crate) stats: SimulationStats,
}

/// The record from the options' bytes or from the cache. Else it is simulated and written to the
/// cache, with a note if that fails.
///
/// `parameters` names the scene and every option that `simulate` depends on, but for the effects
/// left out.
pub(crate) fn recorded<T: Serialize + DeserializeOwned>(
    parameters: &str,
    options: &SceneOptions<'_>,
    simulate: impl FnOnce() -> Record<T>,
) -> (Record<T>, Vec<String>) {
    let without = Effects { simulated: options.without, ..Effects::default() };
    let parameters = &format!("{parameters} without {without}");
    if let Some(record) = options.record.and_then(|bytes| decode(bytes, parameters)) {
        return (record, Vec::new());
    }
    let Some(dir) = &options.cache_dir else {
        return (simulate(), Vec::new());
    };
    let path = cache_path(dir, parameters);
    if let Some(record) = fs::read(&path).ok().and_then(|bytes| decode(&bytes, parameters)) {
        return (record, Vec::new());
    }
    let record = simulate();
    let encoded = encode(&record, parameters).map_err(io::Error::other);
    let write = |bytes: Vec<u8>| {
        fs::create_dir_all(dir)?;
        remove_abandoned(dir);
        write_whole(dir, &path, &bytes)
    };
    let failed = encoded.and_then(write).err();
    let note = |error| format!("key frames could not be cached at {}: {error}", path.display());
    (record, failed.map(note).into_iter().collect())
}

fn cache_path(dir: &Path, parameters: &str) -> PathBuf {
    let scene = parameters.split_whitespace().next().unwrap_or("scene");
    dir.join(format!("{scene}-{:016x}.keys", xxh3_64(parameters.as_bytes())))
}

/// Removes temporary files of processes that were killed while they wrote. No write takes a day.
fn remove_abandoned(dir: &Path) {
    const DAY: Duration = Duration::from_secs(24 * 3600);
    for entry in fs::read_dir(dir).into_iter().flatten().flatten() {
        let is_temporary = |name: &str| name.starts_with(PARTIAL[0]) && name.ends_with(PARTIAL[1]);
        let modified = entry.metadata().and_then(|metadata| metadata.modified());
        let age = modified.ok().and_then(|time| time.elapsed().ok());
        if entry.file_name().to_str().is_some_and(is_temporary) && age.is_some_and(|age| age > DAY) {
            // Another process may have removed it.
            let _ = fs::remove_file(entry.path());
        }
    }
}

fn encode<T: Serialize>(record: &Record<T>, parameters: &str) -> Result<Vec<u8>, postcard::Error> {
    let mut bytes = postcard::to_stdvec(&(SOURCE_HASH, parameters, record))?;
    bytes.extend(xxh3_64(&bytes).to_le_bytes());
    Ok(bytes)
}

fn decode<T: DeserializeOwned>(bytes: &[u8], parameters: &str) -> Option<Record<T>> {
    let (rest, checksum) = bytes.split_last_chunk::<8>()?;
    if xxh3_64(rest) != u64::from_le_bytes(*checksum) {
        return None;
    }
    let (source, made_with, record): (&str, &str, Record<T>) = postcard::from_bytes(rest).ok()?;
    (source == SOURCE_HASH && made_with == parameters).then_some(record)
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    type Data = (Vec<f32>, Vec<u32>);

    fn sample() -> Record<Data> {
        Record {
            data: (vec![1.0, -2.5], vec![7; 100]),
            measures: vec![Measure { name: "drift".to_owned(), value: 1e-3 }],
            stats: SimulationStats { gravity: 7, ..SimulationStats::default() },
        }
    }

    #[test]
    fn decode_gives_back_what_was_encoded_and_rejects_every_damage() {
        let bytes = encode(&sample(), "test 1").unwrap();
        assert_eq!(decode(&bytes, "test 1"), Some(sample()));
        assert_eq!(decode::<Data>(&bytes, "test 2"), None, "other parameters");
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0x10;
            assert_eq!(decode::<Data>(&damaged, "test 1"), None, "byte {at} flipped");
            assert_eq!(decode::<Data>(&bytes[..at], "test 1"), None, "cut at {at}");
        }
    }

    #[test]
    fn damaged_cache_is_rebuilt_and_a_good_one_is_used() {
        let dir = tempfile::tempdir().unwrap();
        let options = SceneOptions { cache_dir: Some(dir.path().to_owned()), ..SceneOptions::default() };
        let runs = Cell::new(0);
        let get = || {
            let found = recorded("test 1", &options, || {
                runs.set(runs.get() + 1);
                sample()
            });
            assert_eq!(found, (sample(), Vec::new()));
        };
        get();
        get();
        assert_eq!(runs.get(), 1, "the second came from the cache");
        let path = cache_path(dir.path(), "test 1 without none");
        let mut bytes = fs::read(&path).unwrap();
        bytes[40] ^= 1;
        fs::write(&path, bytes).unwrap();
        get();
        get();
        assert_eq!(runs.get(), 2, "the damaged file was made again, once");
        assert_eq!(fs::read_dir(&dir).unwrap().count(), 1, "no temporary files are left");
        #[cfg(unix)]
        {
            // Whatever the umask: as of any other file here.
            let mode = |path: &Path| std::os::unix::fs::MetadataExt::mode(&fs::metadata(path).unwrap());
            fs::write(dir.path().join("other"), "").unwrap();
            assert_eq!(mode(&path), mode(&dir.path().join("other")), "others can read it");
        }
    }

    #[test]
    fn records_in_the_options_are_used_only_for_their_own_scene() {
        let bytes = encode(&sample(), "test 1 without none").unwrap();
        let options = SceneOptions { record: Some(&bytes), ..SceneOptions::default() };
        assert_eq!(recorded("test 1", &options, Record::default), (sample(), Vec::new()));
        assert_eq!(recorded("test 2", &options, Record::<Data>::default), (Record::default(), Vec::new()));
    }

    #[test]
    fn cache_that_cannot_be_written_is_noted() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let options = SceneOptions { cache_dir: Some(file.path().to_owned()), ..SceneOptions::default() };
        let (record, notes) = recorded("test 1", &options, sample);
        assert_eq!((record, notes.len()), (sample(), 1));
    }
}
