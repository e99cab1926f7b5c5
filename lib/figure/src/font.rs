//! The font that the binary carries: its metrics and the outlines of its glyphs.

use std::sync::LazyLock;

use ttf_parser::{Face, GlyphId};

/// The file of the font.
pub static BYTES: &[u8] = include_bytes!("../font/DejaVuSans-subset.ttf");

static FACE: LazyLock<Option<Face<'static>>> = LazyLock::new(|| Face::parse(BYTES, 0).ok());

/// Families that an SVG asks for: the font itself, then those of the same widths.
pub const FAMILIES: &str = "DejaVu Sans, Bitstream Vera Sans, Verdana, sans-serif";

/// Width of a text of a size, both in points.
pub fn width(text: &str, size: f64) -> f64 {
    glyphs(text, size).map(|(_, advance)| advance).sum()
}

/// The glyphs of a text and how far each moves on. A character that the font lacks becomes its
/// replacement character.
pub fn glyphs(text: &str, size: f64) -> impl Iterator<Item = (GlyphId, f64)> {
    let face = FACE.as_ref();
    text.chars().filter_map(move |character| {
        let face = face?;
        let glyph = face.glyph_index(character).or_else(|| face.glyph_index('\u{fffd}')).unwrap_or_default();
        let advance = f64::from(face.glyph_hor_advance(glyph).unwrap_or(0));
        Some((glyph, advance * size / f64::from(face.units_per_em())))
    })
}

/// Draw the outline of a glyph, in font units, y upwards.
pub fn outline(glyph: GlyphId, builder: &mut dyn ttf_parser::OutlineBuilder) {
    if let Some(face) = FACE.as_ref() {
        face.outline_glyph(glyph, builder);
    }
}

/// The box that holds every glyph, in thousandths of the size: left, foot, right, top.
pub fn bounds() -> [f32; 4] {
    let unit = 1000.0 / units_per_em() as f32;
    FACE.as_ref().map_or([0.0; 4], |face| {
        let bounds = face.global_bounding_box();
        [bounds.x_min, bounds.y_min, bounds.x_max, bounds.y_max].map(|edge| f32::from(edge) * unit)
    })
}

/// Font units in the height of a line.
pub fn units_per_em() -> f64 {
    FACE.as_ref().map_or(1.0, |face| f64::from(face.units_per_em()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_font_is_there_and_knows_what_labels_use() {
        let face = FACE.as_ref().unwrap();
        for character in "azAZ09()[]=−×·…±σθμ⁻⁰¹²³⁴⁹₀₉é°→√".chars() {
            assert!(face.glyph_index(character).is_some(), "{character}");
        }
    }

    #[test]
    fn widths_are_those_of_dejavu_sans() {
        // Advance of "0" is 1303 of 2048 units (fonttools).
        assert!((width("00", 2048.0) - 2606.0).abs() < 1e-9);
    }
}
