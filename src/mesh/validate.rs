//! Whether a control mesh is one: counts, indices and numbers, each fault with its face and what to do.

use std::collections::HashSet;

use super::{ControlMesh, Interpolation, Primvar, Scheme};
use crate::error::Fault;
use crate::math::Vec3;

impl ControlMesh {
    /// Checks everything that later stages rely on.
    ///
    /// # Errors
    /// The first fault found: a face of fewer than 3 corners, counts that do not add up, indices out of range,
    /// points, sharpnesses or primvars that are not finite, primvars of the wrong length, Loop with other faces
    /// than triangles, motion keys of different lengths.
    pub fn validate(&self) -> Result<(), Fault> {
        self.validate_points()?;
        self.validate_faces()?;
        self.validate_tags()?;
        for primvar in self.primvars.iter().chain(&self.normals) {
            self.validate_primvar(primvar)?;
        }
        Ok(())
    }

    /// The first face that runs through a point more than once, and the point. Such a face has an edge of no
    /// length or touches itself; it is refined as any other, but rarely meant.
    pub fn repeated_corner(&self) -> Option<(usize, u32)> {
        let mut sorted = Vec::new();
        self.faces().enumerate().find_map(|(face, range)| {
            sorted.clear();
            sorted.extend_from_slice(&self.face_vertex_indices[range]);
            sorted.sort_unstable();
            let twice = sorted.windows(2).find(|pair| pair[0] == pair[1]);
            twice.map(|pair| (face, pair[0]))
        })
    }

    /// How many creases are between points that no edge joins, and the points of the first one. They have
    /// no effect.
    pub fn creases_without_edge(&self) -> Option<(usize, [u32; 2])> {
        if self.creases.is_empty() {
            return None;
        }
        let sorted = |[a, b]: [u32; 2]| [a.min(b), a.max(b)];
        let edges: HashSet<[u32; 2]> = (self.faces())
            .flat_map(|range| {
                let face = &self.face_vertex_indices[range];
                let next = face.iter().cycle().skip(1);
                face.iter().zip(next).map(|(&a, &b)| sorted([a, b]))
            })
            .collect();
        let mut missing = (self.creases.iter().map(|c| c.vertices))
            .filter(|&vertices| !edges.contains(&sorted(vertices)));
        let first = missing.next()?;
        Some((1 + missing.count(), first))
    }

    fn validate_points(&self) -> Result<(), Fault> {
        let Some(first) = self.points.first() else {
            return Err(Fault::new("the mesh has no points"));
        };
        if u32::try_from(first.len()).is_err() {
            return Err(Fault::new(format!(
                "{} points are more than 32 bits can number",
                first.len()
            )));
        }
        for (key, points) in self.points.iter().enumerate() {
            if points.len() != first.len() {
                return Err(Fault::new(format!(
                    "motion key {key} has {} points where key 0 has {}",
                    points.len(),
                    first.len()
                ))
                .advise("render without motion blur, or author samples of one length within the shutter"));
            }
            if let Some(i) = points.iter().position(|p| !usable(*p)) {
                return Err(Fault::new(format!("point {i} is {}, not a usable number", points[i]))
                    .advise("repair the points where they are exported; coordinates up to 1e18 are accepted"));
            }
        }
        Ok(())
    }

    fn validate_faces(&self) -> Result<(), Fault> {
        let points = self.point_count();
        if let Some(face) = self.face_vertex_counts.iter().position(|&n| n < 3) {
            return Err(Fault::new(format!(
                "{} corners are too few",
                self.face_vertex_counts[face]
            ))
            .at_face(face)
            .advise("a face has at least 3 corners; remove the face"));
        }
        let corners: u64 = self.face_vertex_counts.iter().map(|&n| u64::from(n)).sum();
        if corners != self.face_vertex_indices.len() as u64 {
            return Err(Fault::new(format!(
                "faceVertexCounts add up to {corners}, but there are {} faceVertexIndices",
                self.face_vertex_indices.len()
            ))
            .advise("both must come from the same version of the mesh"));
        }
        if corners > u64::from(u32::MAX) {
            return Err(Fault::new(format!(
                "{corners} corners are more than 32 bits can number"
            )));
        }
        for (face, range) in self.faces().enumerate() {
            let corners = &self.face_vertex_indices[range];
            if let Some(&v) = corners.iter().find(|&&v| v as usize >= points) {
                return Err(
                    Fault::new(format!("index {v}, but there are {points} points")).at_face(face),
                );
            }
            if self.scheme == Scheme::Loop && corners.len() != 3 {
                return Err(Fault::new(format!(
                    "Loop subdivision of a face with {} corners",
                    corners.len()
                ))
                .at_face(face)
                .advise("triangulate the mesh, or set subdivisionScheme to catmullClark"));
            }
        }
        Ok(())
    }

    fn validate_tags(&self) -> Result<(), Fault> {
        let points = self.point_count();
        let bad_sharpness = |s: f32| s.is_nan() || s < 0.0;
        for (i, crease) in self.creases.iter().enumerate() {
            if let Some(v) = crease.vertices.iter().find(|&&v| v as usize >= points) {
                return Err(Fault::new(format!(
                    "crease {i} names point {v}, but there are {points} points"
                )));
            }
            if bad_sharpness(crease.sharpness) {
                return Err(
                    Fault::new(format!("crease {i} has sharpness {}", crease.sharpness))
                        .advise("sharpness runs from 0 (smooth) to 10 (infinitely sharp)"),
                );
            }
        }
        for (i, corner) in self.corners.iter().enumerate() {
            if corner.vertex as usize >= points {
                return Err(Fault::new(format!(
                    "corner {i} names point {}, but there are {points} points",
                    corner.vertex
                )));
            }
            if bad_sharpness(corner.sharpness) {
                return Err(
                    Fault::new(format!("corner {i} has sharpness {}", corner.sharpness))
                        .advise("sharpness runs from 0 (smooth) to 10 (infinitely sharp)"),
                );
            }
        }
        if let Some(hole) = self
            .holes
            .iter()
            .find(|&&f| f as usize >= self.face_count())
        {
            return Err(Fault::new(format!(
                "holeIndices name face {hole}, but there are {}",
                self.face_count()
            )));
        }
        Ok(())
    }

    /// Checks a primvar that this mesh is to carry.
    ///
    /// # Errors
    /// The first fault found: a wrong count, an index out of range, a number that is not finite.
    pub fn validate_primvar(&self, primvar: &Primvar) -> Result<(), Fault> {
        primvar.validate_count(Some(match primvar.interpolation {
            Interpolation::Constant => (1, "a constant"),
            Interpolation::Uniform => (self.face_count(), "faces"),
            Interpolation::Varying | Interpolation::Vertex => (self.point_count(), "points"),
            Interpolation::FaceVarying => (self.face_vertex_indices.len(), "corners"),
        }))
    }
}

impl Primvar {
    /// Checks its numbers, and that it has the elements that its interpolation needs: how many, and of what.
    /// `None` says that the surface has no such elements.
    pub(super) fn validate_count(
        &self,
        needed: Option<(usize, &'static str)>,
    ) -> Result<(), Fault> {
        let name = &self.name;
        if self.width == 0 || !self.values.len().is_multiple_of(self.width as usize) {
            return Err(Fault::new(format!(
                "primvar {name}: {} numbers are not a whole count of elements of {}",
                self.values.len(),
                self.width
            )));
        }
        let Some((needed, of_what)) = needed else {
            return Err(Fault::new(format!(
                "primvar {name} is faceVarying, and a patch has no faces with corners"
            ))
            .advise("make it varying or vertex"));
        };
        let given = self.indices.as_ref().map_or(self.elements(), Vec::len);
        // A constant may come with more than it needs.
        let exact = self.interpolation != Interpolation::Constant;
        if given < needed || (given > needed && exact) {
            return Err(Fault::new(format!(
                "primvar {name} has {given} elements for {needed} {of_what}"
            ))
            .advise("check the primvar's interpolation and its indices"));
        }
        let elements = self.elements();
        if let Some(&i) = self
            .indices
            .iter()
            .flatten()
            .find(|&&i| i as usize >= elements)
        {
            return Err(Fault::new(format!(
                "primvar {name} has index {i} of {elements} elements"
            )));
        }
        if let Some(i) = self.values.iter().position(|v| !v.is_finite()) {
            return Err(Fault::new(format!(
                "primvar {name}: element {} holds {}, not a finite number",
                i / self.width as usize,
                self.values[i]
            )));
        }
        Ok(())
    }
}

/// Finite, and small enough that products of three coordinates still are.
pub(super) fn usable(p: Vec3) -> bool {
    p.abs().max_element() <= 1e18 && p.is_finite()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quad() -> ControlMesh {
        ControlMesh {
            face_vertex_counts: vec![4],
            face_vertex_indices: vec![0, 1, 2, 3],
            points: vec![vec![Vec3::ZERO, Vec3::X, Vec3::ONE, Vec3::Y]],
            ..ControlMesh::default()
        }
    }

    #[test]
    fn a_quad_is_a_mesh() {
        assert_eq!(quad().validate(), Ok(()));
    }

    #[test]
    fn a_repeated_corner_is_found() {
        let mut mesh = quad();
        assert_eq!(mesh.repeated_corner(), None);
        mesh.face_vertex_indices[3] = 1;
        assert_eq!(mesh.repeated_corner(), Some((0, 1)));
    }

    type Spoil = fn(&mut ControlMesh);

    #[test]
    fn each_fault_says_what_it_found() {
        let faults: [(&str, Spoil); 7] = [
            ("no points", |m| m.points.clear()),
            ("index 7, but there are 4 points", |m| {
                m.face_vertex_indices[2] = 7;
            }),
            ("add up to 4, but there are 3", |m| {
                m.face_vertex_indices.truncate(3);
            }),
            ("2 corners are too few", |m| m.face_vertex_counts[0] = 2),
            ("not a usable number", |m| m.points[0][1].y = f32::NAN),
            ("Loop subdivision of a face with 4 corners", |m| {
                m.scheme = Scheme::Loop;
            }),
            ("name face 1", |m| m.holes.push(1)),
        ];
        for (message, spoil) in faults {
            let mut mesh = quad();
            spoil(&mut mesh);
            let fault = mesh.validate().expect_err(message);
            assert!(fault.to_string().contains(message), "{fault}");
        }
    }
}
