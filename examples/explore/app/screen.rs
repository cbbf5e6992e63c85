//! The screen: the panel beside the picture, and on the picture its two sides, what is wrong with
//! them, and figures.

use bevy::{
    camera::RenderTarget,
    feathers::{theme::ThemeBackgroundColor, tokens},
    input_focus::tab_navigation::TabGroup,
    picking::{events::PointerDrag, hover::Hovered},
    prelude::*,
    render::renderer::RenderDevice,
    ui::{UiSystems, widget::NodeImageMode},
    ui_widgets::ScrollArea,
};
use bevy_pssm::{config::MAX_CASCADES, prelude::*};

use super::{
    counters::{Counters, PLOT_SIZE},
    maps::MapThumbnails,
    open::Opened,
    panel::Panel,
    sides::{Compare, Pictures, Side, SideSun, Technique},
    truth_view::TruthView,
};

/// Width of the panel (logical pixels).
const PANEL: f32 = 330.0;
/// Of the bar that is dragged (logical pixels).
const BAR: f32 = 6.0;
/// Behind text on the picture.
const VEIL: Color = Color::srgba(0.0, 0.0, 0.0, 0.6);

/// Where the picture is.
#[derive(Component)]
pub struct PictureArea;

/// A side's picture, or what is wrong with it.
#[derive(Component)]
struct Shot(Side);

/// A side's figures.
#[derive(Component)]
struct SideCaption(Side);

/// Between the sides.
#[derive(Component)]
pub struct WipeBar;

/// What went wrong, or is to be known.
#[derive(Component)]
struct MessageText;

#[derive(Component)]
struct CounterText;

/// Around figures and plots.
#[derive(Component)]
struct CounterBox;

/// Holds one of [`MapThumbnails`].
#[derive(Component)]
struct Thumbnail(usize);

/// Lays out the screen and keeps it.
pub struct ScreenPlugin;

impl Plugin for ScreenPlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(
            PostUpdate,
            (
                (crop_pictures, write_captions, write_texts, show_maps).before(UiSystems::Prepare),
                fit_pictures.after(UiSystems::Layout),
            ),
        );
    }
}

/// Spawns the screen for a camera of its own.
pub fn spawn_screen(
    commands: &mut Commands,
    target: RenderTarget,
    pictures: &Pictures,
    truth: &TruthView,
    counters: &Counters,
    maps: &MapThumbnails,
) {
    let camera = commands.spawn((Camera2d, target, IsDefaultUiCamera)).id();
    let root = commands
        .spawn((
            Node {
                width: percent(100),
                height: percent(100),
                ..absolute()
            },
            UiTargetCamera(camera),
            TabGroup::new(0),
        ))
        .id();
    commands.spawn((
        Node {
            width: px(PANEL),
            max_width: percent(55),
            height: percent(100),
            max_height: percent(100),
            min_height: px(0),
            flex_shrink: 0.0,
            flex_direction: FlexDirection::Column,
            padding: UiRect::all(px(6)),
            row_gap: px(1),
            overflow: Overflow::scroll_y(),
            ..default()
        },
        ThemeBackgroundColor(tokens::WINDOW_BG),
        ScrollArea,
        Hovered::default(),
        Panel,
        ChildOf(root),
    ));
    let area = commands
        .spawn((
            Node {
                flex_grow: 1.0,
                height: percent(100),
                max_height: percent(100),
                overflow: Overflow::clip(),
                ..default()
            },
            PictureArea,
            ChildOf(root),
        ))
        .id();
    for side in Side::BOTH {
        for image in [&pictures.images, &truth.marks] {
            let image = image[side.index()].clone();
            let node = ImageNode::new(image).with_mode(NodeImageMode::Stretch);
            commands.spawn((node, absolute(), Shot(side), ChildOf(area)));
        }
    }
    commands
        .spawn((
            absolute(),
            BackgroundColor(Color::WHITE),
            WipeBar,
            ChildOf(area),
        ))
        .observe(drag_wipe);
    for side in Side::BOTH {
        commands.spawn((text(), SideCaption(side), ChildOf(area)));
    }
    commands.spawn((text(), MessageText, ChildOf(area)));
    spawn_counters(commands, area, counters);
    spawn_maps(commands, area, maps);
}

fn absolute() -> Node {
    Node {
        position_type: PositionType::Absolute,
        ..default()
    }
}

fn text() -> impl Bundle {
    (
        Text::default(),
        TextFont::from_font_size(13.0),
        Node {
            padding: UiRect::all(px(4)),
            max_width: percent(60),
            ..absolute()
        },
        BackgroundColor(VEIL),
        Pickable::IGNORE,
    )
}

fn spawn_counters(commands: &mut Commands, area: Entity, counters: &Counters) {
    let column = commands
        .spawn((
            Node {
                right: px(6),
                top: px(6),
                padding: UiRect::all(px(4)),
                flex_direction: FlexDirection::Column,
                row_gap: px(4),
                ..absolute()
            },
            BackgroundColor(VEIL),
            Pickable::IGNORE,
            CounterBox,
            ChildOf(area),
        ))
        .id();
    commands.spawn((
        Text::default(),
        TextFont::from_font_size(12.0),
        CounterText,
        ChildOf(column),
    ));
    for plot in &counters.plots {
        commands.spawn((
            Text::new(plot.title),
            TextFont::from_font_size(11.0),
            ChildOf(column),
        ));
        commands.spawn((
            ImageNode::new(plot.image.clone()),
            Node {
                width: px(PLOT_SIZE.x as f32),
                height: px(PLOT_SIZE.y as f32),
                ..default()
            },
            ChildOf(column),
        ));
    }
}

fn spawn_maps(commands: &mut Commands, area: Entity, maps: &MapThumbnails) {
    let grid = commands
        .spawn((
            Node {
                right: px(6),
                bottom: px(40),
                width: px(4.0 * 100.0 + 12.0),
                flex_wrap: FlexWrap::Wrap,
                column_gap: px(4),
                row_gap: px(4),
                ..absolute()
            },
            Pickable::IGNORE,
            ChildOf(area),
        ))
        .id();
    for (index, image) in maps.images.iter().enumerate() {
        commands.spawn((
            ImageNode::new(image.clone()),
            Node {
                width: px(100),
                height: px(100),
                ..default()
            },
            Thumbnail(index),
            ChildOf(grid),
        ));
    }
}

/// The wipe follows the pointer.
fn drag_wipe(
    drag: On<PointerDrag>,
    mut compare: ResMut<Compare>,
    area: Query<&ComputedNode, With<PictureArea>>,
) {
    let Ok(area) = area.single() else {
        return;
    };
    let width = area.size().x * area.inverse_scale_factor();
    if let Some(wipe) = &mut compare.wipe
        && width > 0.0
    {
        *wipe = (*wipe + drag.delta.x / width).clamp(0.0, 1.0);
    }
}

/// Pictures are as large as there is room.
fn fit_pictures(
    mut pictures: ResMut<Pictures>,
    mut images: ResMut<Assets<Image>>,
    area: Query<&ComputedNode, With<PictureArea>>,
) {
    let Ok(area) = area.single() else {
        return;
    };
    let size = area.size().as_uvec2() / pictures.coarseness.max(1);
    if size.min_element() > 0 && size != pictures.size {
        pictures.resize(&mut images, size);
    }
}

/// Each side shows its part of the view.
fn crop_pictures(
    compare: Res<Compare>,
    pictures: Res<Pictures>,
    mut shots: Query<(&Shot, &mut ImageNode, &mut Node), Without<WipeBar>>,
    mut bars: Query<&mut Node, With<WipeBar>>,
) {
    let wipe = compare.wipe.unwrap_or(1.0);
    let size = pictures.size.as_vec2();
    let edge = (wipe * size.x).round();
    for (Shot(side), mut image, mut node) in &mut shots {
        let (from, to) = match side {
            Side::Left => (0.0, edge),
            Side::Right => (edge, size.x),
        };
        let rect = Rect::new(from, 0.0, to, size.y);
        if image.rect != Some(rect) {
            image.rect = Some(rect);
        }
        let percentage = |pixel: f32| percent(100.0 * pixel / size.x.max(1.0));
        let placed = Node {
            left: percentage(from),
            width: percentage(to - from),
            height: percent(100),
            display: if to > from {
                Display::Flex
            } else {
                Display::None
            },
            ..absolute()
        };
        node.set_if_neq(placed);
    }
    for mut bar in &mut bars {
        bar.set_if_neq(Node {
            left: percent(100.0 * wipe),
            margin: UiRect::left(px(-0.5 * BAR)),
            width: px(BAR),
            height: percent(100),
            display: if compare.wipe.is_some() {
                Display::Flex
            } else {
                Display::None
            },
            ..absolute()
        });
    }
}

fn write_captions(
    compare: Res<Compare>,
    truth: Res<TruthView>,
    mut captions: Query<(&SideCaption, &mut Text, &mut Node)>,
) {
    for (SideCaption(side), mut text, mut node) in &mut captions {
        let shown = *side == Side::Left || compare.wipe.is_some();
        let mut place = Node {
            bottom: px(6),
            padding: UiRect::all(px(4)),
            max_width: percent(48),
            display: if shown { Display::Flex } else { Display::None },
            ..absolute()
        };
        match side {
            Side::Left => place.left = px(6),
            Side::Right => place.right = px(6),
        }
        node.set_if_neq(place);
        text.set_if_neq(Text(caption_of(*side, &compare, &truth)));
    }
}

/// Whose shadows a side shows, and what is wrong with them.
pub fn caption_of(side: Side, compare: &Compare, truth: &TruthView) -> String {
    let name = match compare.techniques[side.index()] {
        Technique::Plugin => "bevy_pssm",
        Technique::BuiltIn => "Bevy's own",
        Technique::Tuned => "Bevy's own, tuned",
    };
    if !truth.on {
        return name.into();
    }
    let share = 100.0 * truth.progress;
    let progress = if truth.progress < 1.0 {
        format!("\nrays: {share:.0} %")
    } else {
        String::new()
    };
    match &truth.results[side.index()] {
        Some(result) => {
            let figures = &result.figures;
            format!(
                "{name}: {:.2} % wrong ({:.2} dark, {:.2} leaking), {:.2} % stained{progress}",
                figures.wrong_pct, figures.acne_pct, figures.leak_pct, figures.stain_pct
            )
        }
        None => format!("{name}{progress}"),
    }
}

fn write_texts(
    opened: Res<Opened>,
    compare: Res<Compare>,
    counters: Res<Counters>,
    device: Option<Res<RenderDevice>>,
    suns: Query<(&SideSun, &ParallelSplitShadows)>,
    mut messages: Query<(&mut Text, &mut Node), (With<MessageText>, Without<CounterText>)>,
    mut figures: Query<&mut Text, With<CounterText>>,
    mut boxes: Query<&mut Node, (With<CounterBox>, Without<MessageText>)>,
) {
    for mut node in &mut boxes {
        let display = if counters.on {
            Display::Flex
        } else {
            Display::None
        };
        if node.display != display {
            node.display = display;
        }
    }
    let mut message = opened.message.clone().unwrap_or_default();
    let edited = suns.iter().find(|(sun, _)| sun.0 == compare.edited);
    let largest = device.map_or(u32::MAX, |it| it.limits().max_texture_dimension_2d);
    if let Some(Err(error)) = edited.map(|(_, shadows)| shadows.validate(largest)) {
        message += &format!("\n{error}\nThe last good settings stay in force.");
    }
    let message = message.trim().to_owned();
    for (mut text, mut node) in &mut messages {
        node.set_if_neq(Node {
            left: px(6),
            top: px(6),
            padding: UiRect::all(px(4)),
            max_width: percent(60),
            display: if message.is_empty() {
                Display::None
            } else {
                Display::Flex
            },
            ..absolute()
        });
        text.set_if_neq(Text(message.clone()));
    }
    for mut text in &mut figures {
        text.set_if_neq(Text(counters.text(&compare)));
    }
}

fn show_maps(
    maps: Res<MapThumbnails>,
    compare: Res<Compare>,
    mut thumbnails: Query<(&Thumbnail, &mut Node)>,
) {
    for (Thumbnail(index), mut node) in &mut thumbnails {
        let right = *index >= MAX_CASCADES;
        let side = usize::from(right);
        let shown = maps.on
            && (!right || compare.wipe.is_some())
            && compare.techniques[side] == Technique::Plugin;
        let display = if shown { Display::Flex } else { Display::None };
        if node.display != display {
            node.display = display;
        }
    }
}
