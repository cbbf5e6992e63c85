//! The prediction as text.

use core::{error::Error, fmt::Write};

use super::cascades::{Cascade, Fit, Setup};

/// One line per cascade under a header; fields without a value are empty.
pub fn csv(setup: &Setup) -> Result<String, Box<dyn Error>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for cascade in setup.cascades() {
        writer.serialize(cascade)?;
    }
    Ok(String::from_utf8(writer.into_inner()?)?)
}

/// An aligned table with what it is a prediction for, and totals.
pub fn table(setup: &Setup) -> String {
    let cascades = setup.cascades();
    let mut text = heading(setup);
    text += "\n\
        \x20            interval (m)   pixels per texel   texels per pixel   storage       seam\n\
        \x20cascade    from       to        x        y        x        y    factor        x        y\n";
    for cascade in &cascades {
        let cells = row(cascade).map(|cell| format!(" {cell:>8}"));
        let _ = writeln!(text, "{:>8}{}", cascade.cascade, cells.concat());
    }
    let storage: f64 = cascades.iter().filter_map(|c| c.storage_factor).sum();
    let maps = cascades.iter().filter(|c| c.storage_factor.is_some());
    let texels = maps.count() as f64 * f64::from(setup.map_size).powi(2);
    let pixels = setup.image_height.powi(2) * setup.aspect;
    let _ = writeln!(
        text,
        "\nStorage factor of all maps {}: no texel shows with {} million texels, suitably\n\
         shared; these maps have {} million.",
        digits(storage),
        digits(storage * pixels * 1e-6),
        digits(texels * 1e-6)
    );
    text
}

fn heading(setup: &Setup) -> String {
    let degrees = |angle: f64| digits(angle.to_degrees());
    let half_height = setup.view.max[1].y;
    let angle = setup.to_light.angle_between(setup.view.axes.z_axis);
    let fit = match setup.fit {
        Fit::Body(warp) => format!("fit body, warp {}", format!("{warp:?}").to_lowercase()),
        Fit::Stable => "fit stable".to_owned(),
    };
    format!(
        "{:.0} x {} pixels, {} degrees high; light travels at {} degrees to the view\n\
         {:?}, {} maps of {size} x {size} texels, {fit}\n",
        setup.image_height * setup.aspect,
        setup.image_height,
        degrees(2.0 * half_height.atan()),
        degrees(angle),
        setup.splits,
        setup.planes.len() - 1,
        size = setup.map_size,
    )
}

fn row(cascade: &Cascade) -> [String; 9] {
    [
        Some(cascade.near),
        Some(cascade.far),
        cascade.pixels_per_texel_x,
        cascade.pixels_per_texel_y,
        cascade.texels_per_pixel_x,
        cascade.texels_per_pixel_y,
        cascade.storage_factor,
        cascade.seam_x,
        cascade.seam_y,
    ]
    .map(|cell| cell.map_or_else(|| "-".to_owned(), digits))
}

/// Four significant digits, in at most eight characters.
fn digits(x: f64) -> String {
    let magnitude = x.abs().log10().floor();
    if x != 0.0 && !(-3.0..7.0).contains(&magnitude) {
        return format!("{x:.2e}");
    }
    let decimals = if x == 0.0 {
        0.0
    } else {
        (3.0 - magnitude).max(0.0)
    };
    format!("{x:.*}", decimals as usize)
}
