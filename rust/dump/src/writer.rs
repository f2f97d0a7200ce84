use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rayon::prelude::*;

use crate::dump::check_membership;
use crate::{Dump, DumpError, Manifest, Shard, TileSamples};

/// Receiver of a tracer's tiles. Many threads may write at the same time, each its own tile and pass.
pub trait ShardSink: Sync {
    /// Manifest of the bake.
    fn manifest(&self) -> &Manifest;

    /// True if a tile of a pass is already there, so that it need not be traced again.
    fn is_complete(&self, tile: usize, pass: usize) -> bool;

    /// Stores a tile of a pass.
    ///
    /// # Errors
    /// If the samples do not fit the manifest, or the file cannot be written; then no file is left.
    fn write(&self, tile: usize, pass: usize, samples: &TileSamples) -> Result<(), DumpError>;
}

/// Writes a dump into a folder.
#[derive(Debug)]
pub struct DumpWriter {
    dir: PathBuf,
    manifest: Manifest,
    /// Shards found when resuming, by tile, then pass.
    found: Vec<Vec<bool>>,
}

impl DumpWriter {
    /// Starts a dump in a folder, which is made if it is not there.
    ///
    /// # Errors
    /// If the folder holds a dump already or cannot be written, or the manifest is invalid.
    pub fn create(dir: &Path, manifest: Manifest) -> Result<Self, DumpError> {
        if dir.join(Manifest::FILE).exists() {
            return Err(DumpError::Exists { path: dir.to_owned() });
        }
        Self::start(dir, manifest)
    }

    /// Goes on with the dump in a folder: complete shards stay, damaged ones are removed, to be baked again. Starts
    /// one if there is none. The manifest may ask for more samples than the dump has; if it asks for fewer, the other
    /// shards stay as files and are found when they are asked for again.
    ///
    /// # Errors
    /// If the folder holds a dump of something else, cannot be written, or the manifest is invalid.
    pub fn resume(dir: &Path, manifest: Manifest) -> Result<Self, DumpError> {
        if dir.join(Manifest::FILE).exists() {
            let difference = if Manifest::is_of_another_version(dir) {
                Some("format version")
            } else {
                Manifest::read(dir)?.difference(&manifest)
            };
            if let Some(difference) = difference {
                return Err(DumpError::OtherBake { path: dir.to_owned(), difference });
            }
        }
        let mut writer = Self::start(dir, manifest)?;
        writer.found = writer.find(&|_, _| true)?;
        Ok(writer)
    }

    /// Joins the dump of a folder for some of its tiles and passes. The manifest is another process's, and stays. Shards
    /// that are not ours count as complete, and are not looked at; of ours, damaged ones are removed.
    ///
    /// # Errors
    /// If the manifest or one of our shards cannot be read.
    pub fn join(dir: &Path, is_ours: &(dyn Fn(usize, usize) -> bool + Sync)) -> Result<Self, DumpError> {
        let mut writer = Self::unread(dir, Manifest::read(dir)?);
        writer.found = writer.find(is_ours)?;
        Ok(writer)
    }

    /// Finds the shards that are there and sound, by tile and pass. Reads all of ours; others count as found.
    fn find(&self, is_ours: &(dyn Fn(usize, usize) -> bool + Sync)) -> Result<Vec<Vec<bool>>, DumpError> {
        let is_there =
            |tile, pass| if is_ours(tile, pass) { self.keep_or_remove(tile, pass) } else { Ok(true) };
        let passes = 0..self.manifest.passes.len();
        let of_tile = |tile| passes.clone().map(|pass| is_there(tile, pass)).collect();
        (0..self.manifest.tile_count()).into_par_iter().map(of_tile).collect()
    }

    fn start(dir: &Path, manifest: Manifest) -> Result<Self, DumpError> {
        manifest.check()?;
        fs::create_dir_all(dir).map_err(DumpError::io("create the folder", dir))?;
        manifest.write(dir)?;
        Ok(Self::unread(dir, manifest))
    }

    fn unread(dir: &Path, manifest: Manifest) -> Self {
        let found = vec![vec![false; manifest.passes.len()]; manifest.tile_count()];
        Self { dir: dir.to_owned(), manifest, found }
    }

    fn keep_or_remove(&self, tile: usize, pass: usize) -> Result<bool, DumpError> {
        let path = Manifest::shard_path(&self.dir, tile, pass);
        if !path.exists() {
            return Ok(false);
        }
        let sound = match Shard::open(&path) {
            Ok(shard) => {
                check_membership(&self.manifest, tile, pass, shard.header()).is_ok()
                    && shard.problems(self.manifest.receiver_count()).is_empty()
            }
            Err(DumpError::Damaged { .. }) => false,
            Err(other) => return Err(other),
        };
        if !sound {
            fs::remove_file(&path).map_err(DumpError::io("remove the damaged file", &path))?;
        }
        Ok(sound)
    }

    /// Opens what was written.
    ///
    /// # Errors
    /// See [`Dump::open`].
    pub fn finish(self) -> Result<Dump, DumpError> {
        Dump::open(&self.dir)
    }
}

impl ShardSink for DumpWriter {
    fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    fn is_complete(&self, tile: usize, pass: usize) -> bool {
        self.found.get(tile).and_then(|passes| passes.get(pass)).is_some_and(|&found| found)
    }

    fn write(&self, tile: usize, pass: usize, samples: &TileSamples) -> Result<(), DumpError> {
        let shard = Shard::encode(&self.manifest, tile, pass, samples)?;
        write_shard(&Manifest::shard_path(&self.dir, tile, pass), shard.as_bytes())
    }
}

/// Writes a whole file or nothing: to a temporary file in the same folder, then renamed. Does not wait for the disk: what a
/// power failure tears is found by its hash and traced again.
fn write_shard(path: &Path, bytes: &[u8]) -> Result<(), DumpError> {
    let dir = path.parent().unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    builder.prefix(".relume-").suffix(".tmp");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // What a plain `File::create` gives (the umask applies), so that other users of a farm can read it.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let mut file = builder.tempfile_in(dir).map_err(DumpError::io("create a file", path))?;
    file.write_all(bytes).map_err(DumpError::io("write", path))?;
    file.persist(path).map_err(|error| DumpError::io("rename into place", path)(error.error))?;
    Ok(())
}

/// Collects a dump in memory; [`MemoryWriter::snapshot`] gives what is there so far at any time.
#[derive(Debug)]
pub struct MemoryWriter {
    manifest: Manifest,
    dump: Mutex<Dump>,
}

impl MemoryWriter {
    /// An empty dump.
    ///
    /// # Errors
    /// If the manifest is invalid.
    pub fn new(manifest: Manifest) -> Result<Self, DumpError> {
        Ok(Self { dump: Mutex::new(Dump::in_memory(manifest.clone())?), manifest })
    }

    /// The dump so far; shards are shared, not copied.
    pub fn snapshot(&self) -> Dump {
        self.lock().clone()
    }

    fn lock(&self) -> MutexGuard<'_, Dump> {
        // A dump is whole between calls, whatever a panicking thread was doing.
        self.dump.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl ShardSink for MemoryWriter {
    fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    fn is_complete(&self, tile: usize, pass: usize) -> bool {
        self.lock().has(tile, pass)
    }

    fn write(&self, tile: usize, pass: usize, samples: &TileSamples) -> Result<(), DumpError> {
        let shard = Arc::new(Shard::encode(&self.manifest, tile, pass, samples)?);
        self.lock().insert(tile, pass, shard)
    }
}
