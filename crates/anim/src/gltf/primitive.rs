//! The triangles of one mesh primitive, with the joints and morph targets that move its vertices.

use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Accessor, Index};
use glam::{Vec2, Vec3, Vec3A};

use super::accessor::{ALL, Accessors, Used};
use super::material::Mapping;
use crate::error::Problem;

/// One primitive, decoded; vertices that no triangle uses are left out.
pub(super) struct Geometry {
    pub(super) positions: Vec<Vec3>,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) influences: Option<Influences>,
    pub(super) targets: Vec<Target>,
    pub(super) normals: Option<Vec<Vec3>>,
    /// Where in the base colour texture the vertices lie, if the material has one.
    pub(super) texcoords: Option<Vec<Vec2>>,
}

/// A morph target: the vertices it displaces, and by how much at weight 1.
pub(super) type Target = Vec<(u32, Vec3)>;

/// For each vertex the joints that move it, any number of them, with weights that add up to 1.
pub(super) struct Influences {
    /// Vertex `v` has `joints[first[v]..first[v + 1]]`.
    first: Vec<usize>,
    joints: Vec<(u32, f32)>,
}

impl Influences {
    pub(super) fn of(&self, vertex: usize) -> &[(u32, f32)] {
        &self.joints[self.first[vertex]..self.first[vertex + 1]]
    }

    /// The highest joint number.
    pub(super) fn highest_joint(&self) -> usize {
        self.joints.iter().map(|&(joint, _)| joint as usize).max().unwrap_or(0)
    }

    /// Linear blend skinning of positions or of normals, one for each vertex, by what each joint
    /// makes of them.
    pub(super) fn skin(&self, vectors: &mut [Vec3], by_joint: impl Fn(usize, Vec3A) -> Vec3A) {
        for (vertex, vector) in vectors.iter_mut().enumerate() {
            let bound = Vec3A::from(*vector);
            let mut blended = Vec3A::ZERO;
            for &(joint, weight) in self.of(vertex) {
                blended += by_joint(joint as usize, bound) * weight;
            }
            *vector = blended.into();
        }
    }
}

impl Geometry {
    /// `None` for points and lines, and without positions. `mapping` is of the material's texture,
    /// if it has one.
    pub(super) fn read(
        primitive: &Primitive,
        mapping: Option<&Mapping>,
        accessors: &Accessors<'_>,
        place: &str,
    ) -> Result<Option<Self>, Problem> {
        let mode = match primitive.mode {
            Checked::Valid(Mode::Points | Mode::Lines | Mode::LineLoop | Mode::LineStrip) => return Ok(None),
            Checked::Valid(mode) => mode,
            Checked::Invalid => return Err(Problem::new(place, "an unknown primitive mode", "0 to 6")),
        };
        let used = Used { numbers: None, of: None };
        let mut source = Source { primitive, accessors, place, used };
        let Some(position) = source.attribute(Semantic::Positions) else {
            // Such primitives are to be skipped (3.7.2.1).
            return Ok(None);
        };
        let indices = source.indices(position.0)?;
        let positions: Vec<Vec3> = source.vectors(position)?;
        // More vertices than 32 bits number are refused later, with their part.
        let indices = indices.unwrap_or_else(|| (0..positions.len() as u32).collect());
        let triangles = triangles(mode, &indices, place)?;
        let targets = source.targets()?;
        let influences = source.influences()?;
        let normals = source.attribute(Semantic::Normals).map(|at| source.vectors(at)).transpose()?;
        let texcoords = mapping.and_then(|mapping| {
            let texcoords = source.vectors(source.attribute(Semantic::TexCoords(mapping.set))?);
            Some(texcoords.map(|all| all.into_iter().map(|at| mapping.apply(at)).collect()))
        });
        let texcoords = texcoords.transpose()?;
        Ok(Some(Self { positions, triangles, influences, targets, normals, texcoords }))
    }

    /// Adds the morph targets by their weights; gives the number of displacements.
    pub(super) fn morph(&self, weights: &[f32], positions: &mut [Vec3]) -> usize {
        let mut added = 0;
        for (target, &weight) in self.targets.iter().zip(weights).filter(|&(_, &weight)| weight != 0.0) {
            for &(vertex, delta) in target {
                positions[vertex as usize] += weight * delta;
            }
            added += target.len();
        }
        added
    }
}

/// Renumbers indices from 0 in ascending order, without gaps; gives the old index of each.
fn renumber(indices: &mut [u32]) -> Vec<u32> {
    let least = indices.iter().min().copied().unwrap_or_default();
    let greatest = indices.iter().max().copied().unwrap_or_default();
    if (greatest - least) as usize >= 4 * indices.len() {
        // Few of a large array, which other primitives may share: no memory for all of it, and no
        // more than 16 bytes an index below.
        let mut used = indices.to_vec();
        used.sort_unstable();
        used.dedup();
        let new_index = |old: u32| used.partition_point(|&used| used < old) as u32;
        indices.iter_mut().for_each(|index| *index = new_index(*index));
        return used;
    }
    let mut new_indices = vec![u32::MAX; (greatest - least) as usize + 1];
    indices.iter().for_each(|&index| new_indices[(index - least) as usize] = 0);
    let mut used = Vec::new();
    for (old, new) in (least..=greatest).zip(&mut new_indices).filter(|(_, new)| **new == 0) {
        *new = used.len() as u32;
        used.push(old);
    }
    indices.iter_mut().for_each(|index| *index = new_indices[(*index - least) as usize]);
    used
}

/// An accessor, and how errors name it.
type Attribute = (Index<Accessor>, String);

/// A primitive as the file has it.
struct Source<'a> {
    primitive: &'a Primitive,
    accessors: &'a Accessors<'a>,
    place: &'a str,
    /// The vertices that its triangles use.
    used: Used,
}

impl Source<'_> {
    fn attribute(&self, semantic: Semantic) -> Option<Attribute> {
        let place = format!("{}, {}", self.place, semantic.to_string());
        Some((*self.primitive.attributes.get(&Checked::Valid(semantic))?, place))
    }

    /// A vector of `N` floats for each used vertex.
    fn vectors<const N: usize, V: From<[f32; N]>>(&self, of: Attribute) -> Result<Vec<V>, Problem> {
        let (accessor, place) = of;
        let vectors = self.accessors.read::<f32, N>(accessor, &self.used, &place)?;
        Ok(vectors.into_iter().map(V::from).collect())
    }

    /// The morph targets of the used vertices.
    fn targets(&self) -> Result<Vec<Target>, Problem> {
        let mut targets = Vec::new();
        for (number, target) in self.primitive.targets.iter().flatten().enumerate() {
            let mut displaced = Target::new();
            if let Some(accessor) = target.positions {
                let place = format!("{}, POSITION of morph target {number}", self.place);
                let deltas = self.vectors((accessor, place.clone()))?;
                displaced = (0..).zip(deltas).filter(|&(_, delta)| delta != Vec3::ZERO).collect();
                self.accessors.budget.spend((displaced.len() * size_of::<(u32, Vec3)>()) as u64, &place)?;
            }
            targets.push(displaced);
        }
        Ok(targets)
    }

    /// The indices, if there are any, renumbered so that used vertices are counted from 0. Sets
    /// which these are.
    fn indices(&mut self, positions: Index<Accessor>) -> Result<Option<Vec<u32>>, Problem> {
        let (place, accessors) = (self.place, self.accessors);
        self.used.of = accessors.root.accessors.get(positions.value()).map(|positions| positions.count.0);
        let (Some(count), Some(indices)) = (self.used.of, self.primitive.indices) else { return Ok(None) };
        let indices = accessors.read::<u32, 1>(indices, ALL, &format!("{place}, indices"))?;
        let mut indices = indices.into_flattened();
        if let Some((at, index)) = indices.iter().enumerate().find(|&(_, &index)| u64::from(index) >= count) {
            let expected = format!("an index below the number of vertices, {count}");
            return Err(Problem::new(format!("{place}, index number {at}"), index, expected));
        }
        self.used.numbers = Some(renumber(&mut indices));
        Ok(Some(indices))
    }

    /// Gathers the joints of the used vertices from all sets, of which a mesh may have several,
    /// scaling their weights to a sum of 1.
    ///
    /// A vertex whose weights do not add up to something positive follows its first joint. `None`
    /// without sets.
    fn influences(&self) -> Result<Option<Influences>, Problem> {
        let mut sets = Vec::new();
        for set in 0.. {
            let both = self.attribute(Semantic::Joints(set)).zip(self.attribute(Semantic::Weights(set)));
            let Some(((joints, place), weights)) = both else { break };
            let joints = self.accessors.read::<u32, 4>(joints, &self.used, &place)?;
            sets.push((joints, self.vectors::<4, [f32; 4]>(weights)?));
        }
        if sets.is_empty() {
            return Ok(None);
        }
        let mut influences = Influences { first: vec![0], joints: Vec::new() };
        for vertex in 0..sets[0].0.len() {
            let joints =
                sets.iter().flat_map(|(joints, weights)| joints[vertex].into_iter().zip(weights[vertex]));
            let sum: f32 = joints.clone().map(|(_, weight)| weight).sum();
            if sum > 0.0 && sum.is_finite() {
                let joints = joints.filter(|&(_, weight)| weight != 0.0);
                influences.joints.extend(joints.map(|(joint, weight)| (joint, weight / sum)));
            } else {
                influences.joints.push((sets[0].0[vertex][0], 1.0));
            }
            influences.first.push(influences.joints.len());
        }
        Ok(Some(influences))
    }
}

/// The triangles of vertices in this order.
fn triangles(mode: Mode, vertices: &[u32], place: &str) -> Result<Vec<[u32; 3]>, Problem> {
    let (fits, expected) = match mode {
        Mode::Triangles => (vertices.len().is_multiple_of(3), "a multiple of 3"),
        _ => (vertices.len() >= 3, "at least 3"),
    };
    if !fits {
        let found = format!("{} vertices for {mode:?}", vertices.len());
        return Err(Problem::new(place, found, expected));
    }
    Ok(match mode {
        Mode::TriangleStrip => {
            // Every other triangle is turned over, so that all face the same way.
            let corners = |(i, w): (usize, &[u32])| {
                if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] }
            };
            vertices.windows(3).enumerate().map(corners).collect()
        }
        Mode::TriangleFan => vertices[1..].windows(2).map(|pair| [pair[0], pair[1], vertices[0]]).collect(),
        _ => vertices.as_chunks().0.to_vec(),
    })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::renumber;

    #[test]
    fn used_vertices_are_numbered_in_their_order() {
        let cases: [(u32, u32); 6] =
            [(0, 1), (1, 1), (300, 100), (300, 1200), (300, 10_007), (300, u32::MAX)];
        for (n, span) in cases {
            let mut random = fastrand::Rng::with_seed(n.into());
            let indices: Vec<u32> = (0..n).map(|_| u32::MAX - random.u32(..span)).collect();
            let (mut renumbered, expected) = (indices.clone(), BTreeSet::from_iter(indices.clone()));
            let used = renumber(&mut renumbered);
            assert!(used.iter().eq(&expected), "{n}, {span}");
            let back: Vec<u32> = renumbered.iter().map(|&i| used[i as usize]).collect();
            assert_eq!(back, indices);
        }
    }
}
