//! What two pictures have in common.

use image::RgbaImage;

/// Pixels whose brightest difference in a channel exceeds `levels`, as a share of all.
pub fn share_differing(a: &RgbaImage, b: &RgbaImage, levels: u8) -> f64 {
    assert_eq!(a.dimensions(), b.dimensions());
    let differing = a
        .pixels()
        .zip(b.pixels())
        .filter(|(a, b)| (0..3).any(|c| a[c].abs_diff(b[c]) > levels))
        .count();
    differing as f64 / f64::from(a.width() * a.height())
}

/// Asserts that `found` shows the shadows of `expected`: they make up a fair part of the
/// picture (against `unshadowed`), and but few edge pixels differ.
pub fn assert_same_shadows(
    name: &str,
    found: &RgbaImage,
    expected: &RgbaImage,
    unshadowed: &RgbaImage,
) {
    save(name, found, expected);
    let shadowed = share_differing(expected, unshadowed, 12);
    assert!(
        shadowed > 0.01,
        "{name}: the scene shows hardly any shadow ({shadowed:.4})"
    );
    let wrong = share_differing(found, expected, 40);
    assert!(
        wrong < 0.12 * shadowed,
        "{name}: {wrong:.4} of the picture differ, of {shadowed:.4} in shadow"
    );
}

/// Asserts that no pixel differs.
pub fn assert_identical(name: &str, found: &RgbaImage, expected: &RgbaImage) {
    save(name, found, expected);
    let differing = share_differing(found, expected, 0);
    assert!(
        differing == 0.0,
        "{name}: {differing:.6} of the picture differ"
    );
}

/// Keeps both pictures side by side under `target/test-pictures/` for a look.
pub fn save(name: &str, left: &RgbaImage, right: &RgbaImage) {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/target/test-pictures");
    let mut both = RgbaImage::new(left.width() + right.width(), left.height());
    image::imageops::replace(&mut both, left, 0, 0);
    image::imageops::replace(&mut both, right, i64::from(left.width()), 0);
    std::fs::create_dir_all(folder)
        .and_then(|()| {
            both.save(format!("{folder}/{name}.png"))
                .map_err(std::io::Error::other)
        })
        .expect("pictures can be written");
}
