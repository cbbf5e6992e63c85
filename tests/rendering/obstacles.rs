//! Whatever of the GPU or of Bevy is not as the plugin counts on: Bevy's own shadows stay.

use bevy::{
    pbr::{ShadowView, prepare_lights},
    prelude::*,
    render::{Render, RenderApp, RenderSystems, settings::WgpuSettings},
    shader::{Shader, Source},
};
use bevy_pssm::{
    render::{AdoptedMap, PssmRenderSystems},
    support::Requirements,
};

use crate::{
    compare::assert_identical,
    stage::{Stage, shadows},
    warnings,
};

/// The picture is that of Bevy's own shadows, and one warning says what is not as expected.
fn assert_left_to_bevy(name: &str, warning: &str, setup: impl FnOnce(&mut App)) {
    let mut stage = Stage::new();
    stage.sun();
    let built_in = stage.picture();
    drop(stage);

    warnings::capture();
    let mut stage = Stage::with_app(WgpuSettings::default(), setup);
    let sun = stage.sun();
    stage.world().entity_mut(sun).insert(shadows());
    for _ in 0..4 {
        stage.step();
    }
    assert_identical(name, &stage.picture(), &built_in);
    let adopted = stage
        .render_world()
        .iter_entities()
        .filter(EntityRef::contains::<AdoptedMap>)
        .count();
    assert_eq!(adopted, 0, "{name}: views are adopted");
    let found = warnings::peek();
    let found: Vec<_> = found.iter().filter(|line| line.contains(warning)).collect();
    assert_eq!(found.len(), 1, "{name}: {found:?}");
}

#[test]
fn too_few_array_layers() {
    assert_left_to_bevy("array_layers", "layers, but one light needs", |app| {
        app.insert_resource(Requirements {
            array_layers: u32::MAX,
            ..default()
        });
    });
}

#[test]
fn another_light_uniform() {
    assert_left_to_bevy(
        "light_bytes",
        "of Bevy's light uniform instead of 416",
        |app| {
            app.insert_resource(Requirements {
                light_bytes: 416,
                ..default()
            });
        },
    );
}

#[test]
fn another_shadow_module() {
    // Written in another way, the module still does the same.
    fn rewrite(mut shaders: ResMut<Assets<Shader>>) {
        const FUNCTION: &str = "fn sample_shadow_map(";
        let found = shaders
            .iter()
            .find_map(|(id, shader)| match &shader.source {
                Source::Wesl(text) if shader.path.ends_with("render/shadow_sampling.wesl") => {
                    let text = text
                        .contains(FUNCTION)
                        .then(|| text.replace(FUNCTION, "fn  sample_shadow_map("));
                    Some((id, text?, shader.path.clone()))
                }
                _ => None,
            });
        if let Some((id, text, path)) = found {
            let shader = Shader::from_wesl(text, path);
            shaders.insert(id, shader).expect("the asset is there");
        }
    }
    assert_left_to_bevy("shadow_module", "has no `fn sample_shadow_map(`", |app| {
        app.add_systems(Update, rewrite);
    });
}

#[test]
fn other_pass_labels() {
    fn rename(mut views: Query<&mut ShadowView>) {
        for mut view in &mut views {
            view.pass_name = view.pass_name.replace("directional_light_", "sun_");
        }
    }
    assert_left_to_bevy("pass_labels", "Bevy labels a shadow pass", |app| {
        app.sub_app_mut(RenderApp).add_systems(
            Render,
            rename
                .in_set(RenderSystems::CreateViews)
                .after(prepare_lights)
                .before(PssmRenderSystems::AdoptViews),
        );
    });
}
