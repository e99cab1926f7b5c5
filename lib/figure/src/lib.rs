//! Drawing: axes and panels in millimetres, written as SVG or PNG.

pub mod axis;
pub mod contour;
pub mod figure;
pub mod font;
pub mod matrix;
pub mod panel;
pub mod raster;
pub mod scene;
pub mod svg;
pub mod thin;
