//! Drawing: axes and panels in millimetres, written as SVG, PDF or PNG.

pub mod axis;
pub mod contour;
pub mod figure;
pub mod font;
pub mod matrix;
pub mod number;
pub mod panel;
pub mod pdf;
pub mod raster;
pub mod scene;
pub mod svg;
pub mod thin;
