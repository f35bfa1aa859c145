//! The statements of AFF files and the files they include, as one scene.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3};

use super::geometry::{Frame, Patch, Shape, Source, cone, sphere};
use super::tokens::{Tokens, spaced};
use super::track::{FEWEST_KEYS, Key, Spline, Track};
use crate::budget::{BYTES_PER_BYTE, Budget};
use crate::error::{LoadError, NUMBERED, Problem};
use crate::files::read_file;
use crate::rotation::about;
use crate::{Material, Topology};

/// Files that may include each other in a row.
const DEEPEST_INCLUDE: usize = 64;
/// Bytes that a statement stands for, beyond the triangles it makes. Most of it is time: to find a
/// file, say.
const COST_OF_STATEMENT: u64 = 512;
/// The same for each byte of an include's name, whose folders are looked up one by one: what a byte
/// of text allows for.
const COST_OF_PATH_BYTE: u64 = BYTES_PER_BYTE;

/// The place of what no line alone is to blame for.
const WHOLE_SCENE: &str = "whole scene";

/// The name of a track.
pub(super) type Name = Arc<str>;

/// All that the files say, with motion still by name.
#[derive(Default)]
pub(super) struct Scene {
    pub(super) topology: Topology,
    /// One for each part.
    pub(super) sources: Vec<Source>,
    /// Animated transforms, each after the one it is under: the track, and where its own
    /// coordinates lie before it moves.
    pub(super) nodes: Vec<(Name, Frame)>,
    pub(super) tracks: HashMap<Name, Arc<Track>>,
    pub(super) camera: Option<Camera>,
    /// The first light, with the colours of all added up.
    pub(super) light: Option<AffLight>,
    /// The `a` statement: first time, last time, number of frames.
    pub(super) time: Option<(f64, f64, usize)>,
    /// Lists of keys that were put in order.
    pub(super) disordered: usize,
}

/// The `v` block.
pub(super) struct Camera {
    pub(super) from: DVec3,
    pub(super) at: DVec3,
    pub(super) up: DVec3,
    /// Radians, from top to bottom.
    pub(super) fov_y: f64,
}

pub(super) struct AffLight {
    /// The track that moves it.
    pub(super) track: Option<Name>,
    pub(super) frame: Frame,
    pub(super) position: DVec3,
    pub(super) color: DVec3,
}

/// Reads a scene relative to `origin`; only the camera is left as it stands in the file.
pub(super) fn read(root: &Path, origin: DVec3) -> Result<Scene, LoadError> {
    let canonical = root.canonicalize().map_err(LoadError::io(root))?;
    let mut reader = Reader {
        folder: canonical.parent().unwrap_or(Path::new("/")).to_owned(),
        frame: Frame { node: None, fixed: DAffine3::from_translation(DVec3::ZERO - origin) },
        ..Reader::default()
    };
    reader.set_material(DVec3::from(Material::default().base_color.map(f64::from)), DVec3::ZERO);
    reader.read(root, canonical)?;
    Ok(reader.scene)
}

#[derive(Default)]
struct Reader {
    /// Nothing outside is included.
    folder: PathBuf,
    texts: HashMap<PathBuf, Arc<str>>,
    /// The file being read, and those that include it.
    open: Vec<PathBuf>,
    budget: Budget,
    detail: usize,
    /// Stays as it is set from one file to the next.
    material: u32,
    materials: HashMap<([u32; 3], bool), u32>,
    frame: Frame,
    /// The frames to go back to at closing braces.
    outer: Vec<Frame>,
    scene: Scene,
}

impl Reader {
    fn read(&mut self, file: &Path, canonical: PathBuf) -> Result<(), LoadError> {
        if !self.texts.contains_key(&canonical) {
            let text = read_file(file)?;
            self.budget.allow_for(&canonical, text.len());
            self.texts.insert(canonical.clone(), spaced(&text).into());
        }
        let text = Arc::clone(&self.texts[&canonical]);
        self.open.push(canonical);
        let part = file.file_stem().unwrap_or_default().to_string_lossy();
        let in_file = |problem: Problem| problem.in_file(file);
        self.budget.spend(text.len() as u64, WHOLE_SCENE).map_err(in_file)?;
        let mut tokens = Tokens::new(&text);
        // Braces close in the file that opens them.
        let depth = self.outer.len();
        while let Some(word) = tokens.next() {
            let at_line = |problem: Problem| in_file(tokens.because(problem.found, problem.expected));
            self.budget.spend(COST_OF_STATEMENT, WHOLE_SCENE).map_err(at_line)?;
            match word {
                "i" => {
                    if let Some((included, canonical)) = self.include(&mut tokens, file).map_err(in_file)? {
                        self.read(&included, canonical)?;
                    }
                }
                "}" if self.outer.len() == depth => {
                    return Err(in_file(tokens.problem(Some(word), "a statement, as no brace is open")));
                }
                _ => self.statement(word, &mut tokens, &part).map_err(in_file)?,
            }
        }
        if self.outer.len() > depth {
            return Err(in_file(tokens.problem(None, "\"}\"")));
        }
        self.open.pop();
        Ok(())
    }

    /// `part` is the name of the parts that triangles go to.
    fn statement(&mut self, word: &str, tokens: &mut Tokens<'_>, part: &str) -> Result<(), Problem> {
        match word {
            "xs" | "x" => self.transform(tokens, word == "x")?,
            "}" => self.frame = self.outer.pop().unwrap_or_default(),
            "v" => self.scene.camera = Some(camera(tokens)?),
            "l" | "la" => {
                let name = (word == "la").then(|| tokens.word("the name of a light")).transpose()?;
                let position = tokens.vector()?;
                let has_color = tokens.peek().is_some_and(|word| word.parse::<f64>().is_ok());
                let color = if has_color { tokens.vector()? } else { DVec3::ONE };
                let (track, frame) = (name.map(Name::from), self.frame);
                let first = AffLight { track, frame, position, color: DVec3::ZERO };
                self.scene.light.get_or_insert(first).color += color;
            }
            "a" => self.scene.time = Some(time_span(tokens)?),
            // Colours of the background and of the light from everywhere.
            "b" | "am" => tokens.skip_numbers(3)?,
            "f" => {
                let [red, green, blue, diffuse, specular, _, _, _] = tokens.numbers()?;
                let color = DVec3::new(red, green, blue);
                self.set_material(color * diffuse, color * specular);
            }
            "fm" => {
                tokens.skip_numbers(3)?;
                let (diffuse, specular) = (tokens.vector()?, tokens.vector()?);
                tokens.skip_numbers(3)?;
                self.set_material(diffuse, specular);
            }
            "d" => self.detail = tokens.count("a level of detail")?,
            "k" => self.track(tokens)?,
            "s" => {
                let (center, radius) = (tokens.vector()?, tokens.number()?);
                self.add(sphere(center, radius.abs()), part)?;
            }
            "c" => {
                let base = (tokens.vector()?, tokens.number()?.abs());
                let apex = (tokens.vector()?, tokens.number()?.abs());
                self.add(cone(base, apex), part)?;
            }
            "p" | "pp" => {
                let count = tokens.count_from(3, "vertices")?;
                self.add(fan(tokens, count, if word == "p" { 0 } else { 3 })?, part)?;
            }
            "tt" | "ttp" => {
                tokens.word("the name of a texture")?;
                self.add(fan(tokens, 3, if word == "tt" { 2 } else { 5 })?, part)?;
            }
            "tpa" => self.animated_triangle(tokens, part)?,
            "m" => self.add(mesh(tokens)?, part)?,
            found => {
                let known =
                    "a statement: a, am, b, c, d, f, fm, i, k, l, la, m, p, pp, s, tpa, tt, ttp, v, x or xs";
                return Err(tokens.problem(Some(found), known));
            }
        }
        Ok(())
    }

    /// The file to be read now, and its canonical path; `None` for one of too fine a detail.
    fn include(&self, tokens: &mut Tokens<'_>, file: &Path) -> Result<Option<(PathBuf, PathBuf)>, Problem> {
        let level = tokens.count("a level of detail")?;
        let name = tokens.word("the name of a file")?;
        if level > self.detail {
            return Ok(None);
        }
        let problem = |found: &str, expected: &str| tokens.because(format!("{found} {name:?}"), expected);
        let included = file.parent().unwrap_or(Path::new("")).join(name);
        let spent = self.budget.spend(COST_OF_PATH_BYTE * name.len() as u64, WHOLE_SCENE);
        spent.map_err(|problem| tokens.because(problem.found, problem.expected))?;
        // From a canonical path, so that names do not add up from file to file. A file that is not
        // there has no canonical path either.
        let folder = self.open.last().and_then(|file| file.parent()).unwrap_or(&self.folder);
        let canonical = folder.join(name).canonicalize().map_err(|source| {
            problem(&format!("include of a file that cannot be read ({source})"), "a file")
        })?;
        if !canonical.starts_with(&self.folder) {
            return Err(problem("include of", "a file below the folder of the first file"));
        }
        if self.open.contains(&canonical) {
            return Err(problem("include in a circle of", "a file that is not being read already"));
        }
        if self.open.len() >= DEEPEST_INCLUDE {
            return Err(problem("include of", &format!("files at most {DEEPEST_INCLUDE} deep")));
        }
        Ok(Some((included, canonical)))
    }

    fn transform(&mut self, tokens: &mut Tokens<'_>, animated: bool) -> Result<(), Problem> {
        let mut frame = self.frame;
        if animated {
            let track = tokens.word("the name of a transform")?.into();
            let node = u32::try_from(self.scene.nodes.len());
            let node = node.map_err(|_| tokens.because("too many transforms", NUMBERED))?;
            self.scene.nodes.push((track, frame));
            frame = Frame { node: Some(node), ..Frame::default() };
        } else {
            let (scale, rotation, translation) = (tokens.vector()?, rotation(tokens)?, tokens.vector()?);
            frame.fixed *= DAffine3::from_scale_rotation_translation(scale, rotation, translation);
        }
        tokens.expect("{")?;
        self.outer.push(std::mem::replace(&mut self.frame, frame));
        Ok(())
    }

    /// What has no diffuse colour is a mirror of its specular one; all else is diffuse.
    fn set_material(&mut self, diffuse: DVec3, specular: DVec3) {
        let mirror = diffuse == DVec3::ZERO && specular != DVec3::ZERO;
        let color = if mirror { specular } else { diffuse };
        let base_color = color.as_vec3().to_array().map(|channel| channel.clamp(0.0, 1.0));
        let materials = &mut self.scene.topology.materials;
        self.material = *self.materials.entry((base_color.map(f32::to_bits), mirror)).or_insert_with(|| {
            materials.push(Material { base_color, mirror, ..Material::default() });
            // More than 32 bits can number would take tens of gigabytes of text.
            (materials.len() - 1) as u32
        });
    }

    fn add(&mut self, (vertices, triangles): Shape, part: &str) -> Result<(), Problem> {
        let fixed = self.frame.fixed;
        let local = vertices.iter().map(|vertex| fixed.transform_point3(*vertex).as_vec3()).collect();
        self.extend_part(part, &triangles, Source { node: self.frame.node, local, patches: Vec::new() })
    }

    fn animated_triangle(&mut self, tokens: &mut Tokens<'_>, part: &str) -> Result<(), Problem> {
        let fixed = self.frame.fixed;
        let keys = self.keys(tokens, 1, |tokens| {
            let vertices = tokens.vectors(3, 3)?;
            Ok([0, 1, 2].map(|corner| fixed.transform_point3(vertices[corner]).as_vec3()))
        })?;
        let patches = vec![Patch(keys)];
        self.extend_part(part, &[[0, 1, 2]], Source { node: self.frame.node, local: Vec::new(), patches })
    }

    /// Adds `triangles`, which number the vertices of `more`, to the last part, or as a new part
    /// where the last is of another file, material, transform or kind.
    fn extend_part(&mut self, name: &str, triangles: &[[u32; 3]], more: Source) -> Result<(), Problem> {
        let vertices = more.local.len() + 3 * more.patches.len();
        self.budget.spend_on(vertices, triangles.len(), WHOLE_SCENE)?;
        let Self { scene: Scene { topology, sources, .. }, material, .. } = self;
        let last = topology.parts.pop_if(|part| {
            sources.last().is_some_and(|source| {
                part.name == name
                    && part.material == *material
                    && source.node == more.node
                    && source.patches.is_empty() == more.patches.is_empty()
            })
        });
        let too_large = || Problem::new(WHOLE_SCENE, "too many vertices or triangles", NUMBERED);
        let part =
            topology.add_part(name.to_owned(), triangles, vertices, *material).ok_or_else(too_large)?;
        match (last, sources.last_mut()) {
            (Some(last), Some(source)) => {
                (part.triangles.start, part.vertices.start) = (last.triangles.start, last.vertices.start);
                source.local.extend(more.local);
                source.patches.extend(more.patches);
            }
            _ => sources.push(more),
        }
        Ok(())
    }

    fn track(&mut self, tokens: &mut Tokens<'_>) -> Result<(), Problem> {
        let name = tokens.word("the name of a transform")?;
        tokens.expect("{")?;
        let mut track = Track::default();
        loop {
            match tokens.next() {
                Some("transl") => track.translation = Some(Spline(self.spline(tokens, Tokens::vector)?)),
                Some("rot") => track.rotation = Some(Spline::of_rotations(self.spline(tokens, rotation)?)),
                Some("scale") => track.scale = Some(Spline(self.spline(tokens, Tokens::vector)?)),
                Some("visibility") => track.visibility = self.keys(tokens, 0, visibility)?,
                Some("}") => break,
                found => {
                    return Err(tokens.problem(found, "transl, rot, scale, visibility or \"}\""));
                }
            }
        }
        self.scene.tracks.insert(name.into(), Arc::new(track));
        Ok(())
    }

    /// The keys of a spline, as many as it needs.
    fn spline<'a, T>(
        &mut self,
        tokens: &mut Tokens<'a>,
        value: fn(&mut Tokens<'a>) -> Result<T, Problem>,
    ) -> Result<Vec<Key<T>>, Problem> {
        let keys = self.keys(tokens, FEWEST_KEYS, |tokens| Ok((value(tokens)?, tokens.numbers()?)))?;
        let key = |(time, (value, shape))| Key { time, value, shape };
        Ok(keys.into_iter().map(key).collect())
    }

    /// At least `fewest` keys, each its time and what `value` reads behind it, in order of time.
    /// Counts the lists that were not sorted: scenes of BART itself have such lists.
    fn keys<'a, T>(
        &mut self,
        tokens: &mut Tokens<'a>,
        fewest: usize,
        value: impl Fn(&mut Tokens<'a>) -> Result<T, Problem>,
    ) -> Result<Vec<(f64, T)>, Problem> {
        let mut keys = Vec::new();
        for _ in 0..tokens.count_from(fewest, "keys")? {
            keys.push((tokens.number()?, value(tokens)?));
        }
        if !keys.is_sorted_by(|a, b| a.0 <= b.0) {
            keys.sort_by(|a, b| a.0.total_cmp(&b.0));
            self.scene.disordered += 1;
        }
        Ok(keys)
    }
}

/// A polygon of `count` vertices, each followed by `after` numbers.
fn fan(tokens: &mut Tokens<'_>, count: usize, after: usize) -> Result<Shape, Problem> {
    let vertices = tokens.vectors(count, after)?;
    Ok((vertices, (2..count as u32).map(|corner| [0, corner - 1, corner]).collect()))
}

fn mesh(tokens: &mut Tokens<'_>) -> Result<Shape, Problem> {
    tokens.expect("vertices")?;
    let count = tokens.count("a number of vertices")?;
    let vertices = tokens.vectors(count, 0)?;
    // Numbers after the three vertices of each triangle.
    let mut after = 0;
    for (what, numbers) in [("normals", 3), ("texturecoords", 2)] {
        if tokens.peek() == Some(what) {
            tokens.expect(what)?;
            let count = tokens.count(&format!("a number of {what}"))?;
            if what == "texturecoords" {
                tokens.word("the name of a texture")?;
            }
            tokens.skip_numbers(count.saturating_mul(numbers))?;
            after += 3;
        }
    }
    tokens.expect("triangles")?;
    let mut triangles = Vec::new();
    for _ in 0..tokens.count("a number of triangles")? {
        let mut triangle = [0; 3];
        for corner in &mut triangle {
            let expected = "the number of a vertex";
            let vertex = tokens.count(expected)?;
            if vertex >= count {
                return Err(tokens.because(vertex, format!("{expected} below {count}")));
            }
            *corner = vertex as u32;
        }
        tokens.skip_numbers(after)?;
        triangles.push(triangle);
    }
    Ok((vertices, triangles))
}

/// An axis and an angle in degrees; without an axis there is no rotation.
fn rotation(tokens: &mut Tokens<'_>) -> Result<DQuat, Problem> {
    let (axis, angle) = (tokens.vector()?, tokens.number()?.to_radians());
    Ok(axis.try_normalize().map_or(DQuat::IDENTITY, |axis| about(axis, angle)))
}

fn visibility(tokens: &mut Tokens<'_>) -> Result<bool, Problem> {
    match tokens.next() {
        Some(word @ ("0" | "1")) => Ok(word == "1"),
        found => Err(tokens.problem(found, "0 (invisible) or 1 (visible)")),
    }
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
        return Err(tokens.because(angle, "an angle between 0 and 180 degrees"));
    }
    for (word, numbers) in [("hither", 1), ("resolution", 2)] {
        tokens.expect(word)?;
        tokens.skip_numbers(numbers)?;
    }
    Ok(Camera { from, at, up, fov_y: angle.to_radians() })
}

fn time_span(tokens: &mut Tokens<'_>) -> Result<(f64, f64, usize), Problem> {
    let [start, end] = tokens.numbers()?;
    if start > end {
        let found = format!("an end {end} before the start {start}");
        return Err(tokens.because(found, "the start, then the end"));
    }
    Ok((start, end, tokens.count("a number of frames")?))
}
