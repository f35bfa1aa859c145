//! The triangles of one mesh primitive, with the joints and morph targets that move its vertices.

use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use ::gltf::json::{Accessor, Index};
use glam::{Affine3A, Mat3A, Vec2, Vec3, Vec3A};

use super::accessor::Accessors;
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
    first: Vec<u32>,
    joints: Vec<(u32, f32)>,
}

impl Influences {
    pub(super) fn of(&self, vertex: usize) -> &[(u32, f32)] {
        &self.joints[self.first[vertex] as usize..self.first[vertex + 1] as usize]
    }

    /// The highest joint number.
    pub(super) fn highest_joint(&self) -> usize {
        self.joints.iter().map(|&(joint, _)| joint as usize).max().unwrap_or(0)
    }

    /// Linear blend skinning; `matrices` are from the skin's bind pose to the scene.
    pub(super) fn skin(&self, matrices: &[Affine3A], positions: &mut [Vec3]) {
        for (vertex, position) in positions.iter_mut().enumerate() {
            let bound = Vec3A::from(*position);
            let mut blended = Vec3A::ZERO;
            for &(joint, weight) in self.of(vertex) {
                blended += matrices[joint as usize].transform_point3a(bound) * weight;
            }
            *position = blended.into();
        }
    }

    /// The same of normals, by matrices for normals; lengths are arbitrary.
    pub(super) fn skin_normals(&self, matrices: &[Mat3A], normals: &mut [Vec3]) {
        for (vertex, normal) in normals.iter_mut().enumerate() {
            let bound = Vec3A::from(*normal);
            let joints = self.of(vertex).iter();
            let blended: Vec3A =
                joints.map(|&(joint, weight)| matrices[joint as usize] * bound * weight).sum();
            *normal = blended.into();
        }
    }
}

impl Geometry {
    /// `None` for points and lines. `mapping` is of the material's texture, if it has one.
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
        let attribute = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
        let Some(position) = attribute(Semantic::Positions) else {
            return Err(Problem::new(place, "no POSITION attribute", "one"));
        };
        let positions = accessors.floats::<3>(position, &format!("{place}, POSITION"))?;
        let count = positions.len();
        let mut triangles = triangles(primitive, mode, accessors, count, place)?;
        let kept = keep_used(&mut triangles, count);
        let targets = targets(primitive, accessors, count, &kept, place)?;
        let influences = influences(&joint_sets(primitive, accessors, count, place)?, &kept, place)?;
        let normals = attribute(Semantic::Normals).map(|normals| {
            let all = one_each(accessors, normals, count, &format!("{place}, NORMAL"))?;
            Ok(kept.iter().map(|&old| Vec3::from_array(all[old as usize])).collect())
        });
        let texcoords = mapping.and_then(|m| Some((m, attribute(Semantic::TexCoords(m.set))?)));
        let texcoords = texcoords.map(|(mapping, texcoords)| {
            let all = one_each(accessors, texcoords, count, &format!("{place}, TEXCOORD_{}", mapping.set))?;
            Ok(kept.iter().map(|&old| mapping.apply(Vec2::from_array(all[old as usize]))).collect())
        });
        let (normals, texcoords) = (normals.transpose()?, texcoords.transpose()?);
        let positions = kept.iter().map(|&old| Vec3::from_array(positions[old as usize])).collect();
        Ok(Some(Self { positions, triangles, influences, targets, normals, texcoords }))
    }
}

/// An element of `N` floats for each of `count` positions.
fn one_each<const N: usize>(
    accessors: &Accessors<'_>,
    accessor: Index<Accessor>,
    count: usize,
    place: &str,
) -> Result<Vec<[f32; N]>, Problem> {
    counted(accessors.floats(accessor, place)?, count, place)
}

fn counted<T>(elements: Vec<T>, count: usize, place: &str) -> Result<Vec<T>, Problem> {
    if elements.len() == count {
        return Ok(elements);
    }
    let expected = format!("{count}, one for each position");
    Err(Problem::new(place, format!("{} elements", elements.len()), expected))
}

/// The morph targets, for the kept vertices.
fn targets(
    primitive: &Primitive,
    accessors: &Accessors<'_>,
    count: usize,
    kept: &[u32],
    place: &str,
) -> Result<Vec<Target>, Problem> {
    let mut targets = Vec::new();
    for (number, target) in primitive.targets.iter().flatten().enumerate() {
        let mut displaced = Target::new();
        if let Some(accessor) = target.positions {
            let place = &format!("{place}, POSITION of morph target {number}");
            let all = one_each(accessors, accessor, count, place)?;
            let deltas = kept.iter().map(|&old| Vec3::from_array(all[old as usize]));
            displaced = (0..).zip(deltas).filter(|&(_, delta)| delta != Vec3::ZERO).collect();
            accessors.budget.spend((displaced.len() * size_of::<(u32, Vec3)>()) as u64, place)?;
        }
        targets.push(displaced);
    }
    Ok(targets)
}

/// The joints and weights of all vertices.
fn joint_sets(
    primitive: &Primitive,
    accessors: &Accessors<'_>,
    count: usize,
    place: &str,
) -> Result<Vec<JointSet>, Problem> {
    let attribute = |semantic| primitive.attributes.get(&Checked::Valid(semantic)).copied();
    let mut sets = Vec::new();
    for set in 0.. {
        let both = attribute(Semantic::Joints(set)).zip(attribute(Semantic::Weights(set)));
        let Some((joints, weights)) = both else { break };
        let [at_joints, at_weights] = ["JOINTS", "WEIGHTS"].map(|what| format!("{place}, {what}_{set}"));
        let joints = counted(accessors.integers(joints, &at_joints)?, count, &at_joints)?;
        let weights = one_each(accessors, weights, count, &at_weights)?;
        sets.push((joints, weights));
    }
    Ok(sets)
}

/// Vertex numbers of the triangles, each below `count`.
fn triangles(
    primitive: &Primitive,
    mode: Mode,
    accessors: &Accessors<'_>,
    count: usize,
    place: &str,
) -> Result<Vec<[u32; 3]>, Problem> {
    let vertices = u32::try_from(count).map_err(|_| {
        Problem::new(place, format!("{count} vertices"), "as many as 32-bit indices can name")
    })?;
    let indices: Vec<u32> = match primitive.indices {
        Some(indices) => accessors.integers::<1>(indices, &format!("{place}, indices"))?.into_flattened(),
        None => (0..vertices).collect(),
    };
    if let Some((at, index)) = indices.iter().enumerate().find(|&(_, &index)| index >= vertices) {
        let expected = format!("an index below the number of vertices, {count}");
        return Err(Problem::new(format!("{place}, index number {at}"), index.to_string(), expected));
    }
    let (fits, expected) = match mode {
        Mode::Triangles => (indices.len().is_multiple_of(3), "a multiple of 3"),
        _ => (indices.len() >= 3, "at least 3"),
    };
    if !fits {
        return Err(Problem::new(place, format!("{} vertices for {mode:?}", indices.len()), expected));
    }
    Ok(match mode {
        Mode::TriangleStrip => {
            // Every other triangle is turned over, so that all face the same way.
            let corners =
                |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] };
            indices.windows(3).enumerate().map(corners).collect()
        }
        Mode::TriangleFan => indices[1..].windows(2).map(|pair| [pair[0], pair[1], indices[0]]).collect(),
        _ => indices.chunks_exact(3).map(|corners| [corners[0], corners[1], corners[2]]).collect(),
    })
}

/// Renumbers the vertices of `triangles` without gaps; gives the old number of each.
///
/// Exporters let the primitives of a mesh share one large vertex array, of which each uses a piece.
fn keep_used(triangles: &mut [[u32; 3]], count: usize) -> Vec<u32> {
    let mut used = vec![false; count];
    for &corner in triangles.as_flattened() {
        used[corner as usize] = true;
    }
    let kept: Vec<u32> = (0..).zip(&used).filter(|&(_, &used)| used).map(|(old, _)| old).collect();
    let mut new_number = vec![0; count];
    for (new, &old) in (0..).zip(&kept) {
        new_number[old as usize] = new;
    }
    for corner in triangles.as_flattened_mut() {
        *corner = new_number[*corner as usize];
    }
    kept
}

/// Joints and their weights, four of each for every vertex; a mesh may have several sets.
type JointSet = (Vec<[u32; 4]>, Vec<[f32; 4]>);

/// Gathers the joints of the kept vertices from all sets, scaling their weights to a sum of 1.
///
/// A vertex whose weights do not add up to something positive follows its first joint. `None` without
/// sets.
fn influences(sets: &[JointSet], kept: &[u32], place: &str) -> Result<Option<Influences>, Problem> {
    if sets.is_empty() {
        return Ok(None);
    }
    let mut influences = Influences { first: vec![0], joints: Vec::new() };
    for vertex in kept.iter().map(|&vertex| vertex as usize) {
        let joints =
            sets.iter().flat_map(|(joints, weights)| joints[vertex].into_iter().zip(weights[vertex]));
        let sum: f32 = joints.clone().map(|(_, weight)| weight).sum();
        if sum > 0.0 && sum.is_finite() {
            let joints = joints.filter(|&(_, weight)| weight != 0.0);
            influences.joints.extend(joints.map(|(joint, weight)| (joint, weight / sum)));
        } else {
            influences.joints.push((sets[0].0[vertex][0], 1.0));
        }
        let end = u32::try_from(influences.joints.len())
            .map_err(|_| Problem::new(place, "more joint weights than 32 bits can count", "fewer"))?;
        influences.first.push(end);
    }
    Ok(Some(influences))
}
