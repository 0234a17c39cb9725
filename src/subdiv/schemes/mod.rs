//! The schemes, one file each.

pub(in crate::subdiv) mod bilinear;
pub(in crate::subdiv) mod catmull_clark;
pub(in crate::subdiv) mod loop_scheme;
