//! A picture as PDF, with its font in it and its text as text.

use std::collections::BTreeMap;
use std::io::Write;

use anyhow::Result;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use pdf_writer::types::{CidFontType, FontFlags, LineCapStyle, LineJoinStyle, SystemInfo, UnicodeCmap};
use pdf_writer::{Content, Filter, Finish, Name, Pdf, Ref, Str, TextStr};

use crate::font;
use crate::scene::{Anchor, Color, Item, Paint, Point, Rect, Scene};

const FONT: Name = Name(b"DejaVu");
const BASE_FONT: Name = Name(b"GLPLOT+DejaVuSans");
const IDENTITY: SystemInfo =
    SystemInfo { registry: Str(b"Adobe"), ordering: Str(b"Identity"), supplement: 0 };

/// The PDF of a picture, of one page that is as large as it.
///
/// # Errors
/// Never, in practice: if compressing in memory fails.
pub fn render(scene: &Scene) -> Result<Vec<u8>> {
    let [catalog, pages, page, content, info] = [1, 2, 3, 4, 5].map(Ref::new);
    let mut canvas = Canvas::new(scene.height);
    scene.items.iter().for_each(|item| canvas.draw(item));
    let drawing = compressed(&canvas.content.finish())?;

    let mut pdf = Pdf::new();
    pdf.document_info(info).title(TextStr(&scene.title)).producer(TextStr("gl-plot"));
    pdf.catalog(catalog).pages(pages);
    pdf.pages(pages).kids([page]).count(1);
    let mut sheet = pdf.page(page);
    sheet.media_box(pdf_writer::Rect::new(0.0, 0.0, scene.width as f32, scene.height as f32));
    sheet.parent(pages).contents(content);
    let mut resources = sheet.resources();
    resources.fonts().pair(FONT, FONT_REFS[0]);
    let mut states = resources.ext_g_states();
    for (percent, name) in &canvas.opacities {
        let opacity = f32::from(*percent) / 100.0;
        let mut state = states.insert(Name(name.as_bytes())).start::<pdf_writer::writers::ExtGraphicsState>();
        state.stroking_alpha(opacity).non_stroking_alpha(opacity);
    }
    states.finish();
    resources.finish();
    sheet.finish();
    pdf.stream(content, &drawing).filter(Filter::FlateDecode);
    add_font(&mut pdf, &canvas.glyphs)?;
    Ok(pdf.finish())
}

/// Font, its glyphs, what they measure, its file, and the characters they stand for.
const FONT_REFS: [Ref; 5] = [Ref::new(11), Ref::new(12), Ref::new(13), Ref::new(14), Ref::new(15)];

fn add_font(pdf: &mut Pdf, glyphs: &BTreeMap<u16, (char, f64)>) -> Result<()> {
    let [font, cid, descriptor, file, characters] = FONT_REFS;
    pdf.type0_font(font)
        .base_font(BASE_FONT)
        .encoding_predefined(Name(b"Identity-H"))
        .descendant_font(cid)
        .to_unicode(characters);
    let mut glyph_font = pdf.cid_font(cid);
    glyph_font.subtype(CidFontType::Type2).base_font(BASE_FONT).system_info(IDENTITY);
    glyph_font.font_descriptor(descriptor).cid_to_gid_map_predefined(Name(b"Identity"));
    let mut widths = glyph_font.widths();
    for (&glyph, &(_, advance)) in glyphs {
        widths.same(glyph, glyph, advance as f32);
    }
    widths.finish();
    glyph_font.finish();
    let bounds = font::bounds();
    pdf.font_descriptor(descriptor)
        .name(BASE_FONT)
        .flags(FontFlags::NON_SYMBOLIC)
        .bbox(pdf_writer::Rect::new(bounds[0], bounds[1], bounds[2], bounds[3]))
        .italic_angle(0.0)
        .ascent(bounds[3])
        .descent(bounds[1])
        .cap_height(729.0)
        .stem_v(80.0)
        .font_file2(file);
    let bytes = compressed(font::BYTES)?;
    pdf.stream(file, &bytes).filter(Filter::FlateDecode);
    let mut map = UnicodeCmap::new(Name(b"Characters"), IDENTITY);
    glyphs.iter().for_each(|(&glyph, &(character, _))| map.pair(glyph, character));
    pdf.cmap(characters, &map.finish()).name(Name(b"Characters")).system_info(IDENTITY);
    Ok(())
}

fn compressed(bytes: &[u8]) -> Result<Vec<u8>> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes)?;
    Ok(encoder.finish()?)
}

struct Canvas {
    content: Content,
    /// PDF counts from the foot.
    height: f64,
    /// Opacities in per cent, and what they are called.
    opacities: BTreeMap<u8, String>,
    /// Glyphs that are used: their character, and how far each moves on in thousandths of the size.
    glyphs: BTreeMap<u16, (char, f64)>,
}

impl Canvas {
    fn new(height: f64) -> Self {
        let mut content = Content::new();
        content.set_line_join(LineJoinStyle::RoundJoin);
        Self { content, height, opacities: BTreeMap::new(), glyphs: BTreeMap::new() }
    }

    fn draw(&mut self, item: &Item) {
        match item {
            Item::Path { lines, closed, paint } => self.draw_path(lines, *closed, paint),
            Item::Dots { points, diameter, color, opacity } => {
                if points.is_empty() {
                    return;
                }
                self.content.save_state();
                self.set_opacity(*opacity);
                self.set_stroke(*color, *diameter);
                self.content.set_line_cap(LineCapStyle::RoundCap);
                for &point in points {
                    let (x, y) = self.at(point);
                    self.content.move_to(x, y).line_to(x, y);
                }
                self.content.stroke().restore_state();
            }
            Item::Text { at, text, size, anchor, turned, color } => {
                self.write(*at, text, *size, *anchor, *turned, *color);
            }
            Item::Group { clip, items, .. } => {
                self.content.save_state();
                if let Some(Rect { x0, y0, x1, y1 }) = clip {
                    let (x, y) = self.at((*x0, *y1));
                    self.content.rect(x, y, (x1 - x0) as f32, (y1 - y0) as f32).clip_nonzero().end_path();
                }
                items.iter().for_each(|item| self.draw(item));
                self.content.restore_state();
            }
        }
    }

    fn draw_path(&mut self, lines: &[Vec<Point>], closed: bool, paint: &Paint) {
        if lines.iter().all(Vec::is_empty) {
            return;
        }
        self.content.save_state();
        self.set_opacity(paint.opacity);
        if let Some(Color(color)) = paint.fill {
            let [red, green, blue] = channels(color);
            self.content.set_fill_rgb(red, green, blue);
        }
        if let Some((color, width)) = paint.stroke {
            self.set_stroke(color, width);
        }
        if let Some((on, off)) = paint.dash {
            self.content.set_dash_pattern([on as f32, off as f32], 0.0);
        }
        for line in lines {
            for (i, &point) in line.iter().enumerate() {
                let (x, y) = self.at(point);
                if i == 0 {
                    self.content.move_to(x, y)
                } else {
                    self.content.line_to(x, y)
                };
            }
            if closed && !line.is_empty() {
                self.content.close_path();
            }
        }
        match (paint.fill, paint.stroke) {
            (Some(_), Some(_)) => self.content.fill_nonzero_and_stroke(),
            (Some(_), None) => self.content.fill_nonzero(),
            (None, Some(_)) => self.content.stroke(),
            (None, None) => self.content.end_path(),
        };
        self.content.restore_state();
    }

    fn write(&mut self, at: Point, text: &str, size: f64, anchor: Anchor, turned: bool, color: Color) {
        let before = match anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => font::width(text, size) / 2.0,
            Anchor::End => font::width(text, size),
        };
        let mut bytes = Vec::new();
        for (character, (glyph, advance)) in text.chars().zip(font::glyphs(text, 1000.0)) {
            self.glyphs.entry(glyph.0).or_insert((character, advance));
            bytes.extend(glyph.0.to_be_bytes());
        }
        let (x, y) = self.at(if turned { (at.0, at.1 + before) } else { (at.0 - before, at.1) });
        let [red, green, blue] = channels(color.0);
        let turn = if turned { [0.0, 1.0, -1.0, 0.0, x, y] } else { [1.0, 0.0, 0.0, 1.0, x, y] };
        self.content.set_fill_rgb(red, green, blue).begin_text().set_font(FONT, size as f32);
        self.content.set_text_matrix(turn).show(Str(&bytes)).end_text();
    }

    fn at(&self, (x, y): Point) -> (f32, f32) {
        (hundredth(x), hundredth(self.height - y))
    }

    fn set_stroke(&mut self, Color(color): Color, width: f64) {
        let [red, green, blue] = channels(color);
        self.content.set_stroke_rgb(red, green, blue).set_line_width(width as f32);
    }

    fn set_opacity(&mut self, opacity: f64) {
        let percent = (100.0 * opacity.clamp(0.0, 1.0)).round() as u8;
        if percent < 100 {
            let name = self.opacities.entry(percent).or_insert_with(|| format!("o{percent}"));
            self.content.set_parameters(Name(name.as_bytes()));
        }
    }
}

/// A coordinate to a hundredth of a point, which no eye can tell.
fn hundredth(value: f64) -> f32 {
    ((value * 100.0).round() / 100.0) as f32
}

fn channels(color: u32) -> [f32; 3] {
    let [_, red, green, blue] = color.to_be_bytes();
    [red, green, blue].map(|channel| f32::from(channel) / 255.0)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::scene::{color, text};

    #[test]
    fn a_pdf_is_as_large_as_the_picture_and_the_same_each_time() {
        let items = vec![text((10.0, 20.0), "σ = 5 µm", 8.0, Anchor::Start)];
        let scene = Scene { width: 240.0, height: 100.0, title: "A (b".to_owned(), items };
        let pdf = render(&scene).unwrap();
        assert_eq!(pdf, render(&scene).unwrap());
        let text = String::from_utf8_lossy(&pdf);
        assert!(text.starts_with("%PDF-") && text.trim_end().ends_with("%%EOF"));
        assert!(text.contains("/MediaBox [0 0 240 100]"), "{text:.500}");
        assert!(text.contains("/FontFile2"));
    }

    #[test]
    fn what_is_empty_draws_nothing() {
        let dots = Item::Dots { points: Vec::new(), diameter: 1.0, color: color::INK, opacity: 0.5 };
        let mut canvas = Canvas::new(10.0);
        canvas.draw(&dots);
        canvas.draw_path(&[Vec::new()], true, &Paint::area(color::INK));
        assert!(canvas.opacities.is_empty());
        assert_eq!(canvas.content.finish().as_slice(), b"1 j");
    }
}
