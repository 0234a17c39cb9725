//! Where a shape stands in the world, for its hits.

use glam::Vec3A;

use crate::math::{Affine3A, Ray, Vec3};

/// Where a shape stands while the shutter is open.
pub(super) enum Stand {
    /// It was built in world space.
    InWorld,
    Still(Space),
    /// Its transforms at motion keys evenly over the shutter.
    Moving(Vec<Affine3A>),
}

/// A shape's own space.
pub(super) struct Space {
    world_from_object: Affine3A,
    object_from_world: Affine3A,
    /// No direction is stretched by more than this.
    stretch: f32,
}

impl Stand {
    /// By the transforms at motion keys evenly over the shutter, at least one.
    pub(super) fn new(keys: Vec<Affine3A>) -> Self {
        match keys[..] {
            [key] => Self::Still(Space::new(key)),
            _ => Self::Moving(keys),
        }
    }

    /// The shape's space at a time, in 0..1, unless that is the world.
    #[inline]
    pub(super) fn at<'a>(&'a self, time: f32, moved: &'a mut Option<Space>) -> Option<&'a Space> {
        match self {
            Self::InWorld => None,
            Self::Still(space) => Some(space),
            Self::Moving(keys) => Some(moved.insert(Space::new(at_time(keys, time)))),
        }
    }
}

impl Space {
    fn new(world_from_object: Affine3A) -> Self {
        Self {
            world_from_object,
            object_from_world: world_from_object.inverse(),
            stretch: stretch(&world_from_object),
        }
    }

    pub(super) fn stretch(&self) -> f32 {
        self.stretch
    }

    /// A ray of the world's in object space.
    pub(super) fn ray_from_world(&self, ray: &Ray) -> Ray {
        ray.transformed(&self.object_from_world)
    }

    pub(super) fn point_to_world(&self, point: Vec3) -> Vec3 {
        self.world_from_object.transform_point3(point)
    }

    pub(super) fn vector_to_world(&self, vector: Vec3) -> Vec3 {
        self.world_from_object.transform_vector3(vector)
    }

    /// Normals transform by the inverse transpose; their lengths change.
    pub(super) fn normal_to_world(&self, normal: Vec3) -> Vec3 {
        Vec3::from(self.object_from_world.matrix3.transpose() * Vec3A::from(normal))
    }
}

/// No vector gets longer by more than this: its square bounds the eigenvalues of the matrix's product with itself
/// (Gershgorin). What only turns and scales it bounds exactly.
fn stretch(map: &Affine3A) -> f32 {
    let columns = [map.matrix3.x_axis, map.matrix3.y_axis, map.matrix3.z_axis];
    let row = |a: &Vec3A| columns.iter().map(|b| a.dot(*b).abs()).sum::<f32>();
    columns.iter().map(row).fold(0.0, f32::max).sqrt()
}

/// Element-wise between motion keys, as Embree itself interpolates the matrices of an instance.
fn at_time(keys: &[Affine3A], time: f32) -> Affine3A {
    let [.., last] = keys else {
        return Affine3A::IDENTITY;
    };
    let position = time.clamp(0.0, 1.0) * (keys.len() - 1) as f32;
    let first = position.floor() as usize;
    if first + 1 >= keys.len() {
        return *last;
    }
    let (a, b, f) = (&keys[first], &keys[first + 1], position - first as f32);
    Affine3A {
        matrix3: a.matrix3 * (1.0 - f) + b.matrix3 * f,
        translation: a.translation * (1.0 - f) + b.translation * f,
    }
}
