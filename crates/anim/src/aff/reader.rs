//! The statements of AFF files and the files they include, as one scene.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3};

use super::geometry::{Frame, Geometry, Group, Patch, PatchKey, cone, sphere};
use super::tokens::Tokens;
use super::track::{FEWEST_KEYS, Key, Spline, Track, Value};
use crate::Material;
use crate::error::{LoadError, NUMBERED, Problem, read_file};

/// Files that may include each other in a row.
const DEEPEST_INCLUDE: usize = 64;
/// A scene may take this many bytes, whatever its files are like, ...
const ALWAYS_ALLOWED: usize = 1 << 30;
/// ... and this many times the bytes of its files, each counted once.
const LARGEST_GROWTH: usize = 512;
/// Bytes that a vertex or a triangle takes in a whole program: its coordinates and the tree over
/// it.
const BYTES_PER_ELEMENT: usize = 120;
/// Bytes that a statement stands for, beyond the triangles it makes. Most of it is time: to find a
/// file, say.
const COST_OF_STATEMENT: usize = 512;

/// All that the files say, with motion still by name.
pub(super) struct Scene {
    pub(super) geometry: Geometry,
    /// Animated transforms, each after the one it is under.
    pub(super) nodes: Vec<Node>,
    pub(super) tracks: HashMap<Vec<u8>, Arc<Track>>,
    pub(super) camera: Option<Camera>,
    pub(super) lights: Vec<AffLight>,
    /// The `a` statement: first time, last time, number of frames.
    pub(super) time: Option<(f64, f64, usize)>,
    /// Lists of keys that were put in order.
    pub(super) disordered: usize,
}

pub(super) struct Node {
    pub(super) track: Rc<[u8]>,
    /// Where its own coordinates lie, before it moves.
    pub(super) frame: Frame,
}

/// The `v` block.
#[derive(Clone, Copy)]
pub(super) struct Camera {
    pub(super) from: DVec3,
    pub(super) at: DVec3,
    pub(super) up: DVec3,
    /// Radians, from top to bottom.
    pub(super) fov_y: f64,
}

pub(super) struct AffLight {
    /// Name of the track that moves it.
    pub(super) track: Option<Rc<[u8]>>,
    pub(super) frame: Frame,
    pub(super) position: DVec3,
    pub(super) color: DVec3,
}

/// Reads a scene relative to `origin`; only the camera is left as it stands in the file.
pub(super) fn read(root: &Path, origin: DVec3) -> Result<Scene, LoadError> {
    let io = |source| LoadError::Io { file: root.to_owned(), source };
    let canonical = root.canonicalize().map_err(io)?;
    let mut reader = Reader {
        folder: canonical.parent().unwrap_or(Path::new("/")).to_owned(),
        texts: HashMap::new(),
        open: Vec::new(),
        distinct_bytes: 0,
        bytes: 0,
        detail: 0,
        material: 0,
        materials: HashMap::new(),
        frame: Frame { node: None, fixed: DAffine3::from_translation(DVec3::ZERO - origin) },
        scene: Scene {
            geometry: Geometry::default(),
            nodes: Vec::new(),
            tracks: HashMap::new(),
            camera: None,
            lights: Vec::new(),
            time: None,
            disordered: 0,
        },
    };
    reader.set_material(DVec3::from(Material::default().base_color.map(f64::from)), DVec3::ZERO);
    reader.read(root, canonical)?;
    Ok(reader.scene)
}

struct Reader {
    /// Nothing outside is included.
    folder: PathBuf,
    texts: HashMap<PathBuf, Rc<[u8]>>,
    /// The file being read, and those that include it.
    open: Vec<PathBuf>,
    distinct_bytes: usize,
    /// All text read so far, repeated or not, and what its statements cost.
    bytes: usize,
    detail: usize,
    /// Stays as it is set from one file to the next.
    material: u32,
    materials: HashMap<([u32; 3], bool), u32>,
    frame: Frame,
    scene: Scene,
}

impl Reader {
    fn read(&mut self, file: &Path, canonical: PathBuf) -> Result<(), LoadError> {
        let text = match self.texts.get(&canonical) {
            Some(text) => Rc::clone(text),
            None => {
                let text: Rc<[u8]> = read_file(file)?.into();
                self.distinct_bytes += text.len();
                Rc::clone(self.texts.entry(canonical.clone()).or_insert(text))
            }
        };
        self.bytes += text.len();
        self.open.push(canonical);
        let part = file.file_stem().unwrap_or_default().to_string_lossy();
        let in_file = |problem: Problem| problem.in_file(file);
        let mut tokens = Tokens::new(&text);
        // The braces open in this file.
        let mut outer = Vec::new();
        while let Some(word) = tokens.next() {
            self.bytes += COST_OF_STATEMENT;
            match word {
                b"xs" => outer.push(self.fixed_transform(&mut tokens).map_err(in_file)?),
                b"x" => outer.push(self.animated_transform(&mut tokens).map_err(in_file)?),
                b"}" => {
                    let closed = outer.pop();
                    let none = || tokens.problem(Some(word), "a statement, as no brace is open");
                    self.frame = closed.ok_or_else(none).map_err(in_file)?;
                }
                b"i" => self.include(&mut tokens, file)?,
                _ => self.statement(word, &mut tokens, &part).map_err(in_file)?,
            }
            if self.size() > ALWAYS_ALLOWED.saturating_add(LARGEST_GROWTH.saturating_mul(self.distinct_bytes))
            {
                let found = "a scene that outgrows its files";
                let expected = format!("a scene at most {LARGEST_GROWTH} times as large as its files");
                return Err(in_file(tokens.because(found, expected)));
            }
        }
        if !outer.is_empty() {
            return Err(in_file(tokens.problem(None, "\"}\"")));
        }
        self.open.pop();
        self.scene.disordered += tokens.disordered;
        Ok(())
    }

    /// About the bytes read and made so far.
    fn size(&self) -> usize {
        let geometry = &self.scene.geometry;
        let elements = geometry.positions.len() + geometry.topology.triangles.len();
        self.bytes.saturating_add(elements.saturating_mul(BYTES_PER_ELEMENT))
    }

    /// `part` is the name of the parts that triangles go to.
    fn statement(&mut self, word: &[u8], tokens: &mut Tokens<'_>, part: &str) -> Result<(), Problem> {
        match word {
            b"v" => self.scene.camera = Some(camera(tokens)?),
            b"l" => self.light(tokens, None)?,
            b"la" => {
                let name = tokens.word("the name of a light")?.into();
                self.light(tokens, Some(name))?;
            }
            b"a" => self.scene.time = Some(time_span(tokens)?),
            // Colours of the background and of the light from everywhere.
            b"b" | b"am" => tokens.skip_numbers(3)?,
            b"f" => {
                let (color, diffuse, specular) = (tokens.vector()?, tokens.number()?, tokens.number()?);
                tokens.skip_numbers(3)?;
                self.set_material(color * diffuse, color * specular);
            }
            b"fm" => {
                tokens.skip_numbers(3)?;
                let (diffuse, specular) = (tokens.vector()?, tokens.vector()?);
                tokens.skip_numbers(3)?;
                self.set_material(diffuse, specular);
            }
            b"d" => self.detail = tokens.count("a level of detail")?,
            b"k" => self.track(tokens)?,
            b"s" => {
                let (center, radius) = (tokens.vector()?, tokens.number()?);
                let (vertices, triangles) = sphere(center, radius.abs());
                self.add(&vertices, &triangles, part)?;
            }
            b"c" => {
                let base = (tokens.vector()?, tokens.number()?.abs());
                let apex = (tokens.vector()?, tokens.number()?.abs());
                let (vertices, triangles) = cone(base, apex);
                self.add(&vertices, &triangles, part)?;
            }
            b"p" => self.polygon(tokens, 0, part)?,
            b"pp" => self.polygon(tokens, 3, part)?,
            b"tt" => self.textured_triangle(tokens, 2, part)?,
            b"ttp" => self.textured_triangle(tokens, 5, part)?,
            b"tpa" => self.animated_triangle(tokens, part)?,
            b"m" => self.mesh(tokens, part)?,
            found => {
                let known =
                    "a statement: a, am, b, c, d, f, fm, i, k, l, la, m, p, pp, s, tpa, tt, ttp, v, x or xs";
                return Err(tokens.problem(Some(found), known));
            }
        }
        Ok(())
    }

    fn include(&mut self, tokens: &mut Tokens<'_>, file: &Path) -> Result<(), LoadError> {
        let (level, name) = (|| {
            let level = tokens.count("a level of detail")?;
            Ok::<_, Problem>((level, tokens.word("the name of a file")?))
        })()
        .map_err(|p| p.in_file(file))?;
        if level > self.detail {
            return Ok(());
        }
        let problem = |found: &str, expected: &str| {
            let found = format!("{found} {:?}", String::from_utf8_lossy(name));
            tokens.because(found, expected).in_file(file)
        };
        let Ok(name_text) = str::from_utf8(name) else {
            return Err(problem("include of", "a name in UTF-8"));
        };
        let included = file.parent().unwrap_or(Path::new("")).join(name_text);
        // A file that is not there has no canonical path either.
        let canonical = included.canonicalize().map_err(|source| {
            problem(&format!("include of a file that cannot be read ({source})"), "a file")
        })?;
        if !canonical.starts_with(&self.folder) {
            return Err(problem("include of", "a file below the folder of the first file"));
        }
        if self.open.contains(&canonical) {
            return Err(problem("include in a circle of", "a file that is not being read already"));
        }
        if self.open.len() >= DEEPEST_INCLUDE {
            let expected = format!("files at most {DEEPEST_INCLUDE} deep");
            return Err(problem("include of", &expected));
        }
        self.read(&included, canonical)
    }

    /// The frame to go back to at the closing brace.
    fn fixed_transform(&mut self, tokens: &mut Tokens<'_>) -> Result<Frame, Problem> {
        let (scale, rotation, translation) = (tokens.vector()?, rotation(tokens)?, tokens.vector()?);
        tokens.expect("{")?;
        let outer = self.frame;
        self.frame.fixed *= DAffine3::from_scale_rotation_translation(scale, rotation, translation);
        Ok(outer)
    }

    fn animated_transform(&mut self, tokens: &mut Tokens<'_>) -> Result<Frame, Problem> {
        let track = tokens.word("the name of a transform")?.into();
        tokens.expect("{")?;
        let outer = self.frame;
        let node = u32::try_from(self.scene.nodes.len())
            .map_err(|_| tokens.because("too many transforms", NUMBERED))?;
        self.scene.nodes.push(Node { track, frame: outer });
        self.frame = Frame { node: Some(node), ..Frame::WORLD };
        Ok(outer)
    }

    fn light(&mut self, tokens: &mut Tokens<'_>, track: Option<Rc<[u8]>>) -> Result<(), Problem> {
        let position = tokens.vector()?;
        let color = if tokens.next_is_number() { tokens.vector()? } else { DVec3::ONE };
        self.scene.lights.push(AffLight { track, frame: self.frame, position, color });
        Ok(())
    }

    /// What has no diffuse colour is a mirror of its specular one; all else is diffuse.
    fn set_material(&mut self, diffuse: DVec3, specular: DVec3) {
        let mirror = diffuse == DVec3::ZERO && specular != DVec3::ZERO;
        let color = if mirror { specular } else { diffuse };
        let base_color = color.as_vec3().to_array().map(|channel| channel.clamp(0.0, 1.0));
        let materials = &mut self.scene.geometry.topology.materials;
        self.material = *self.materials.entry((base_color.map(f32::to_bits), mirror)).or_insert_with(|| {
            materials.push(Material { base_color, mirror, ..Material::default() });
            // More than 32 bits can number would take tens of gigabytes of text.
            (materials.len() - 1) as u32
        });
    }

    fn group<'a>(&self, part: &'a str) -> Group<'a> {
        Group { name: part, frame: self.frame, material: self.material }
    }

    fn add(&mut self, vertices: &[DVec3], triangles: &[[u32; 3]], part: &str) -> Result<(), Problem> {
        self.scene.geometry.add(self.group(part), vertices, triangles).ok_or_else(too_large)
    }

    /// `after` numbers follow each vertex.
    fn polygon(&mut self, tokens: &mut Tokens<'_>, after: usize, part: &str) -> Result<(), Problem> {
        let expected = "a number of vertices from 3 up";
        let count = tokens.count(expected)?;
        if count < 3 {
            return Err(tokens.because(count.to_string(), expected));
        }
        let vertices = vectors(tokens, count, after)?;
        let fan: Vec<[u32; 3]> = (2..count as u32).map(|corner| [0, corner - 1, corner]).collect();
        self.add(&vertices, &fan, part)
    }

    fn textured_triangle(
        &mut self,
        tokens: &mut Tokens<'_>,
        after: usize,
        part: &str,
    ) -> Result<(), Problem> {
        tokens.word("the name of a texture")?;
        let vertices = vectors(tokens, 3, after)?;
        self.add(&vertices, &[[0, 1, 2]], part)
    }

    fn animated_triangle(&mut self, tokens: &mut Tokens<'_>, part: &str) -> Result<(), Problem> {
        let expected = "a number of keys from 1 up";
        let count = tokens.count(expected)?;
        if count == 0 {
            return Err(tokens.because("0", expected));
        }
        let mut keys: Vec<PatchKey> = Vec::new();
        for _ in 0..count {
            let time = tokens.number()?;
            let vertices = vectors(tokens, 3, 3)?;
            let corner = |i: usize| self.frame.fixed.transform_point3(vertices[i]).as_vec3();
            keys.push(PatchKey { time, corners: [0, 1, 2].map(corner) });
        }
        put_in_order(&mut keys, |key| key.time, tokens);
        self.scene.geometry.add_patch(self.group(part), Patch(keys)).ok_or_else(too_large)
    }

    fn mesh(&mut self, tokens: &mut Tokens<'_>, part: &str) -> Result<(), Problem> {
        tokens.expect("vertices")?;
        let count = tokens.count("a number of vertices")?;
        let vertices = vectors(tokens, count, 0)?;
        // Numbers after the three vertices of each triangle.
        let mut after = 0;
        if tokens.peek() == Some(b"normals") {
            tokens.expect("normals")?;
            let count = tokens.count("a number of normals")?;
            vectors(tokens, count, 0)?;
            after += 3;
        }
        if tokens.peek() == Some(b"texturecoords") {
            tokens.expect("texturecoords")?;
            let count = tokens.count("a number of texture coordinates")?;
            tokens.word("the name of a texture")?;
            (0..count).try_for_each(|_| tokens.skip_numbers(2))?;
            after += 3;
        }
        tokens.expect("triangles")?;
        let triangle_count = tokens.count("a number of triangles")?;
        let mut triangles = Vec::new();
        for _ in 0..triangle_count {
            let mut triangle = [0; 3];
            for corner in &mut triangle {
                let expected = "the number of a vertex";
                let vertex = tokens.count(expected)?;
                if vertex >= count {
                    return Err(tokens.because(vertex.to_string(), format!("{expected} below {count}")));
                }
                *corner = vertex as u32;
            }
            tokens.skip_numbers(after)?;
            triangles.push(triangle);
        }
        self.add(&vertices, &triangles, part)
    }

    fn track(&mut self, tokens: &mut Tokens<'_>) -> Result<(), Problem> {
        let name = tokens.word("the name of a transform")?;
        tokens.expect("{")?;
        let mut track = Track::default();
        loop {
            let kind = tokens.next();
            match kind {
                Some(b"transl") => track.translation = Some(spline(tokens, Tokens::vector, Spline::new)?),
                Some(b"rot") => track.rotation = Some(spline(tokens, rotation, Spline::of_rotations)?),
                Some(b"scale") => track.scale = Some(spline(tokens, Tokens::vector, Spline::new)?),
                Some(b"visibility") => track.visibility = visibility(tokens)?,
                Some(b"}") => break,
                found => {
                    return Err(tokens.problem(found, "transl, rot, scale, visibility or \"}\""));
                }
            }
        }
        self.scene.tracks.insert(name.to_owned(), Arc::new(track));
        Ok(())
    }
}

fn too_large() -> Problem {
    Problem::new("whole scene", "too many vertices or triangles", NUMBERED)
}

/// As many vectors, each followed by `after` numbers that are left out.
fn vectors(tokens: &mut Tokens<'_>, count: usize, after: usize) -> Result<Vec<DVec3>, Problem> {
    // Grows as the vectors come: the count may be a lie.
    let mut vectors = Vec::new();
    for _ in 0..count {
        vectors.push(tokens.vector()?);
        tokens.skip_numbers(after)?;
    }
    Ok(vectors)
}

/// An axis and an angle in degrees; without an axis there is no rotation.
fn rotation(tokens: &mut Tokens<'_>) -> Result<DQuat, Problem> {
    let (axis, angle) = (tokens.vector()?, tokens.number()?.to_radians());
    Ok(axis.try_normalize().map_or(DQuat::IDENTITY, |axis| DQuat::from_axis_angle(axis, angle)))
}

fn spline<'a, T: Value>(
    tokens: &mut Tokens<'a>,
    value: fn(&mut Tokens<'a>) -> Result<T, Problem>,
    new: fn(Vec<Key<T>>) -> Option<Spline<T>>,
) -> Result<Spline<T>, Problem> {
    let expected = format!("a number of keys from {FEWEST_KEYS} up");
    let count = tokens.count(&expected)?;
    if count < FEWEST_KEYS {
        return Err(tokens.because(count.to_string(), expected));
    }
    let mut keys = Vec::new();
    for _ in 0..count {
        keys.push(Key {
            time: tokens.number()?,
            value: value(tokens)?,
            tension: tokens.number()?,
            continuity: tokens.number()?,
            bias: tokens.number()?,
        });
    }
    put_in_order(&mut keys, |key| key.time, tokens);
    new(keys).ok_or_else(|| tokens.because(count.to_string(), expected))
}

/// Sorts keys by time, and counts the lists that were not sorted. Scenes of BART itself have such
/// lists.
fn put_in_order<T>(keys: &mut [T], time: impl Fn(&T) -> f64, tokens: &mut Tokens<'_>) {
    if !keys.is_sorted_by(|a, b| time(a) <= time(b)) {
        keys.sort_by(|a, b| time(a).total_cmp(&time(b)));
        tokens.disordered += 1;
    }
}

fn visibility(tokens: &mut Tokens<'_>) -> Result<Vec<(f64, bool)>, Problem> {
    let count = tokens.count("a number of keys")?;
    let mut keys: Vec<(f64, bool)> = Vec::new();
    for _ in 0..count {
        let time = tokens.number()?;
        let visible = match tokens.next() {
            Some(b"0") => false,
            Some(b"1") => true,
            found => return Err(tokens.problem(found, "0 (invisible) or 1 (visible)")),
        };
        keys.push((time, visible));
    }
    put_in_order(&mut keys, |key| key.0, tokens);
    Ok(keys)
}

fn camera(tokens: &mut Tokens<'_>) -> Result<Camera, Problem> {
    let mut vector = |word| {
        tokens.expect(word)?;
        tokens.vector()
    };
    let (from, at, up) = (vector("from")?, vector("at")?, vector("up")?);
    tokens.expect("angle")?;
    let angle = tokens.number()?;
    if !(0.0 < angle && angle < 180.0) {
        return Err(tokens.because(angle.to_string(), "an angle between 0 and 180 degrees"));
    }
    for (word, numbers) in [("hither", 1), ("resolution", 2)] {
        tokens.expect(word)?;
        tokens.skip_numbers(numbers)?;
    }
    Ok(Camera { from, at, up, fov_y: angle.to_radians() })
}

fn time_span(tokens: &mut Tokens<'_>) -> Result<(f64, f64, usize), Problem> {
    let (start, end) = (tokens.number()?, tokens.number()?);
    if start > end {
        let found = format!("an end {end} before the start {start}");
        return Err(tokens.because(found, "the start, then the end"));
    }
    Ok((start, end, tokens.count("a number of frames")?))
}
