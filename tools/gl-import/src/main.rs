//! Turn a folder of GrainLearning runs into tables.
fn main() {}
