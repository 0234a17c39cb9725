//! Stamps the versions of the libraries into the program.
fn main() {}
