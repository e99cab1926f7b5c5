//! Whole pipelines through the real binaries, a module for each subject, in one program: it is linked once, and no processor idles
//! while the last test of a subject runs.

#![allow(clippy::unwrap_used)]

mod bad_input;
mod calibration;
mod closed_form;
mod closest;
mod cluster;
mod drivers;
mod embedded;
mod emulate;
mod fuzz;
mod gap;
mod gap_attribute;
mod grainlearning;
mod hard_edges;
mod help;
mod house;
mod import;
mod measured;
mod packed;
mod plot;
mod posterior;
mod right;
mod run;
mod said;
mod sensitivity;
mod several;
mod several_causes;
mod withheld;
mod yade;
