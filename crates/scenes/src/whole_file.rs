//! Files that appear whole or not at all.

use std::io::{self, Write};
use std::path::Path;

/// How the temporary names of [`write_whole`] begin and end.
pub const PARTIAL: [&str; 2] = [".pivot-", ".partial"];

/// Writes a file under a short temporary name in `folder`, its own, and renames it: no reader ever
/// sees half a file, not even after a power failure. Everybody whom the umask allows may read it.
///
/// # Errors
///
/// If that fails; then nothing is left, and a file that was there is as it was.
pub fn write_whole(folder: &Path, path: &Path, content: &[u8]) -> io::Result<()> {
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut partial = builder.prefix(PARTIAL[0]).suffix(PARTIAL[1]).tempfile_in(folder)?;
    partial.write_all(content)?;
    // Some file systems report a full disk only here.
    partial.as_file().sync_all()?;
    partial.persist(path)?;
    Ok(())
}
