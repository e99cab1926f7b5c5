//! A picture as PNG.

use anyhow::{Context, Result};
use tiny_skia::{
    Color as SkiaColor, FillRule, LineJoin, Mask, PathBuilder, Pixmap, Stroke, StrokeDash, Transform,
};

use crate::font;
use crate::scene::{Anchor, Color, Item, Point, Rect, Scene};

const INCH: f64 = 72.0;
const METRES_IN_INCH: f64 = 0.0254;

/// The PNG of a picture at `dpi` pixels an inch.
///
/// # Errors
/// If the picture is too large for memory.
pub fn render(scene: &Scene, dpi: f64) -> Result<Vec<u8>> {
    let scale = dpi / INCH;
    let pixels = |length: f64| (length * scale).round().max(1.0) as u32;
    let (width, height) = (pixels(scene.width), pixels(scene.height));
    let too_large = || format!("a picture of {width} by {height} pixels is too large");
    let pixmap = Pixmap::new(width, height).with_context(too_large)?;
    let mut canvas = Canvas { pixmap, transform: Transform::from_scale(scale as f32, scale as f32) };
    canvas.pixmap.fill(SkiaColor::WHITE);
    for item in &scene.items {
        canvas.draw(item, None);
    }

    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let pixels_per_metre = (dpi / METRES_IN_INCH).round() as u32;
    encoder.set_pixel_dims(Some(png::PixelDimensions {
        xppu: pixels_per_metre,
        yppu: pixels_per_metre,
        unit: png::Unit::Meter,
    }));
    let mut writer = encoder.write_header()?;
    // On white everything is opaque, and the fourth channel says nothing.
    let rgb: Vec<u8> = canvas.pixmap.data().chunks_exact(4).flat_map(|pixel| &pixel[..3]).copied().collect();
    writer.write_image_data(&rgb)?;
    writer.finish()?;
    Ok(bytes)
}

struct Canvas {
    pixmap: Pixmap,
    transform: Transform,
}

impl Canvas {
    fn draw(&mut self, item: &Item, clip: Option<&Mask>) {
        match item {
            Item::Path { lines, closed, paint } => {
                let mut builder = PathBuilder::new();
                for line in lines {
                    add_line(&mut builder, line, *closed);
                }
                let Some(path) = builder.finish() else { return };
                if let Some(color) = paint.fill {
                    let fill = ink(color, paint.opacity);
                    self.pixmap.fill_path(&path, &fill, FillRule::Winding, self.transform, clip);
                }
                if let Some((color, width)) = paint.stroke {
                    let dash =
                        paint.dash.and_then(|(on, off)| StrokeDash::new(vec![on as f32, off as f32], 0.0));
                    let stroke =
                        Stroke { width: width as f32, line_join: LineJoin::Round, dash, ..Stroke::default() };
                    self.pixmap.stroke_path(&path, &ink(color, paint.opacity), &stroke, self.transform, clip);
                }
            }
            Item::Dots { points, diameter, color, opacity } => {
                let mut builder = PathBuilder::new();
                for &(x, y) in points {
                    builder.push_circle(x as f32, y as f32, (diameter / 2.0) as f32);
                }
                let Some(path) = builder.finish() else { return };
                let fill = ink(*color, *opacity);
                self.pixmap.fill_path(&path, &fill, FillRule::Winding, self.transform, clip);
            }
            Item::Text { at, text, size, anchor, turned, color } => {
                self.write(*at, text, *size, *anchor, *turned, *color, clip);
            }
            Item::Group { clip: rect, items, .. } => {
                let mask = rect.as_ref().and_then(|rect| self.mask(rect));
                items.iter().for_each(|item| self.draw(item, mask.as_ref().or(clip)));
            }
        }
    }

    fn mask(&self, rect: &Rect) -> Option<Mask> {
        let mut mask = Mask::new(self.pixmap.width(), self.pixmap.height())?;
        let mut builder = PathBuilder::new();
        add_line(&mut builder, &rect.corners(), true);
        mask.fill_path(&builder.finish()?, FillRule::Winding, true, self.transform);
        Some(mask)
    }

    #[allow(clippy::too_many_arguments)]
    fn write(
        &mut self,
        at: Point,
        text: &str,
        size: f64,
        anchor: Anchor,
        turned: bool,
        color: Color,
        clip: Option<&Mask>,
    ) {
        let mut x = match anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => -font::width(text, size) / 2.0,
            Anchor::End => -font::width(text, size),
        };
        let unit = (size / font::units_per_em()) as f32;
        let mut place = Transform::from_translate(at.0 as f32, at.1 as f32);
        if turned {
            place = place.pre_rotate(-90.0);
        }
        let mut builder = Outline { path: PathBuilder::new(), x: 0.0, unit };
        for (glyph, advance) in font::glyphs(text, size) {
            builder.x = x as f32;
            font::outline(glyph, &mut builder);
            x += advance;
        }
        let Some(path) = builder.path.finish() else { return };
        let transform = place.post_concat(self.transform);
        self.pixmap.fill_path(&path, &ink(color, 1.0), FillRule::Winding, transform, clip);
    }
}

fn add_line(builder: &mut PathBuilder, line: &[Point], closed: bool) {
    for (i, &(x, y)) in line.iter().enumerate() {
        if i == 0 {
            builder.move_to(x as f32, y as f32);
        } else {
            builder.line_to(x as f32, y as f32);
        }
    }
    if closed && !line.is_empty() {
        builder.close();
    }
}

fn ink(Color(color): Color, opacity: f64) -> tiny_skia::Paint<'static> {
    let mut paint = tiny_skia::Paint { anti_alias: true, ..tiny_skia::Paint::default() };
    let [_, red, green, blue] = color.to_be_bytes();
    paint.set_color_rgba8(red, green, blue, (opacity.clamp(0.0, 1.0) * 255.0).round() as u8);
    paint
}

/// Glyph outlines, scaled to points and turned y downwards.
struct Outline {
    path: PathBuilder,
    x: f32,
    unit: f32,
}

impl Outline {
    fn at(&self, x: f32, y: f32) -> (f32, f32) {
        (self.x + self.unit * x, -self.unit * y)
    }
}

impl ttf_parser::OutlineBuilder for Outline {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.path.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.at(x, y);
        self.path.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ((x1, y1), (x, y)) = (self.at(x1, y1), self.at(x, y));
        self.path.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ((x1, y1), (x2, y2), (x, y)) = (self.at(x1, y1), self.at(x2, y2), self.at(x, y));
        self.path.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.path.close();
    }
}
