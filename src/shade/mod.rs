//! Camera, sampling, materials, lights: what a picture is made with besides its surfaces. Knows the scene
//! description and images by their traits; knows no mesh, no ray caster and no integrator.

pub mod bsdf;
pub mod camera;
pub mod filter;
pub mod light;
pub mod material;
pub mod microfacet;
pub mod sampler;
pub mod texture_map;
