//! Vectors, rays and their widths, boxes and frames. Vectors are glam's; transforms are column-vector affine maps named
//! destination-from-source (`world_from_object`).

mod bounds;
mod cone;
mod disjoint;
mod disk;
mod frame;
mod ray;
mod roots;

pub use bounds::Bounds3;
pub use cone::{Area, Cone};
pub use disjoint::DisjointSets;
pub use disk::concentric_disk;
pub use frame::Frame;
pub use glam::{Affine2, Affine3A, DAffine3, DMat4, DVec2, DVec3, DVec4, Vec2, Vec3, Vec4};
pub use ray::Ray;
pub use roots::{Real, first_cubic_root, quadratic};
