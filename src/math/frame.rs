use super::Vec3;

/// A right-handed orthonormal frame. "Local" is the space in which `normal` is +z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Local x.
    pub tangent: Vec3,
    /// Local y.
    pub bitangent: Vec3,
    /// Local z.
    pub normal: Vec3,
}

impl Frame {
    /// Some frame around the unit vector `normal` (Duff et al. 2017, "Building an Orthonormal Basis, Revisited").
    pub fn around(normal: Vec3) -> Self {
        let (tangent, bitangent) = normal.any_orthonormal_pair();
        Self {
            tangent,
            bitangent,
            normal,
        }
    }

    /// The components of the world vector `v` in this frame.
    pub fn local_from_world(&self, v: Vec3) -> Vec3 {
        Vec3::new(
            v.dot(self.tangent),
            v.dot(self.bitangent),
            v.dot(self.normal),
        )
    }

    /// The world vector whose components in this frame are `v`.
    pub fn world_from_local(&self, v: Vec3) -> Vec3 {
        v.x * self.tangent + v.y * self.bitangent + v.z * self.normal
    }
}
