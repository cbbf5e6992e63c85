//! The panel: a widget for every control, kept equal to what it controls.

use bevy::{
    feathers::{
        controls::{
            FeathersButton, FeathersSelect, FeathersSlider, FeathersToggleSwitch, OptionIndex,
            list_rows_from_strings,
        },
        display::{caption, label, label_small},
    },
    input_focus::{FocusCause, InputFocus, tab_navigation::TabIndex},
    prelude::*,
    ui::{Checked, Selected, UiSystems},
    ui_widgets::{
        Activate, ScrollIntoView, Slider, SliderPrecision, SliderStep, SliderValue, TrackClick,
        ValueChange,
    },
};

use super::{
    controls::{Control, Controls, Edit, Line, State, To},
    keys::key_of,
    settings::{Track, Value},
};

/// What scrolls.
#[derive(Component)]
pub struct Panel;

/// What the panel shows now.
#[derive(Resource, Default)]
struct Shown(Vec<Line>);

/// Sets a control back.
#[derive(Component, Clone, PartialEq)]
struct Reset(Control);

/// On sliders.
#[derive(Component)]
struct Numbers(Track);

/// The chosen one of several.
#[derive(Component)]
struct Chosen(usize);

/// Fills the panel and keeps it.
pub struct PanelPlugin;

impl Plugin for PanelPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<Shown>()
            .add_systems(
                PostUpdate,
                (
                    (build_widgets, (follow_values, show_focused))
                        .chain()
                        .before(UiSystems::Prepare),
                    write_numbers.before(UiSystems::Content),
                ),
            )
            .add_observer(on_number)
            .add_observer(on_flag)
            .add_observer(on_choice)
            .add_observer(on_press);
    }
}

/// Makes all widgets anew where others are needed.
fn build_widgets(
    mut commands: Commands,
    controls: Controls,
    mut shown: ResMut<Shown>,
    panel: Query<Entity, With<Panel>>,
    focus: Res<InputFocus>,
    of_control: Query<&Control>,
    parents: Query<&ChildOf>,
) {
    let (lines, Ok(panel)) = (controls.lines(), panel.single()) else {
        return;
    };
    let same = lines.len() == shown.0.len()
        && lines
            .iter()
            .zip(&shown.0)
            .all(|(new, old)| new.is_like(old));
    if same {
        shown.bypass_change_detection().0 = lines;
        return;
    }
    let focused = focus.get().and_then(|focus| {
        let mut around = core::iter::once(focus).chain(parents.iter_ancestors(focus));
        around.find_map(|entity| of_control.get(entity).ok().cloned())
    });
    commands.entity(panel).despawn_children();
    for line in &lines {
        spawn_line(&mut commands, panel, line);
    }
    shown.0 = lines;
    if let Some(control) = focused {
        commands.queue(move |world: &mut World| focus_on(world, &control));
    }
}

/// Whoever had the keyboard gets it back.
fn focus_on(world: &mut World, control: &Control) {
    let mut controls = world.query::<(Entity, &Control)>();
    let widget = controls.iter(world).find(|(_, it)| *it == control);
    let Some((widget, _)) = widget else {
        return;
    };
    let mut takes_keys = world.query_filtered::<(), With<TabIndex>>();
    let mut children = world.query::<&Children>();
    let mut around = vec![widget];
    while let Some(entity) = around.pop() {
        if takes_keys.get(world, entity).is_ok() {
            let mut focus = world.resource_mut::<InputFocus>();
            focus.set(entity, FocusCause::Navigated);
            return;
        }
        if let Ok(children) = children.get(world, entity) {
            around.extend(children.iter().rev());
        }
    }
}

fn spawn_line(commands: &mut Commands, panel: Entity, line: &Line) {
    let row = commands
        .spawn((
            Node {
                min_height: px(26),
                padding: UiRect::left(px(10.0 * line.depth as f32)),
                column_gap: px(4),
                align_items: AlignItems::Center,
                flex_shrink: 0.0,
                ..default()
            },
            ChildOf(panel),
        ))
        .id();
    let name = commands
        .spawn((
            Node {
                width: percent(if line.state == State::None { 100 } else { 42 }),
                flex_shrink: 0.0,
                ..default()
            },
            ChildOf(row),
        ))
        .id();
    if line.state == State::None {
        commands
            .spawn_scene(label(line.label.clone()))
            .insert(ChildOf(name));
    } else if line.state != State::Button {
        commands
            .spawn_scene(label_small(match key_of(&line.control) {
                Some(key) => format!("{} [{key}]", line.label),
                None => line.label.clone(),
            }))
            .insert(ChildOf(name));
    }
    spawn_widget(commands, row, line);
    if let Control::Setting(_) = line.control {
        commands
            .spawn_scene(bsn! {
                @FeathersButton { @caption: bsn! { @caption("×") } }
                Node { padding: UiRect::horizontal(px(4)) }
            })
            .insert((
                ChildOf(row),
                Reset(line.control.clone()),
                shown_if(line.changed),
            ));
    }
}

fn spawn_widget(commands: &mut Commands, row: Entity, line: &Line) {
    let names = |names: &[String], chosen: usize| list_rows_from_strings(names, Some(chosen));
    let widget = match &line.state {
        State::None => return,
        State::Value(Value::Number {
            value,
            range,
            whole,
        }) => {
            let track = Track::new(range.as_ref(), *whole);
            let (position, step) = (track.position(*value), track.step());
            let mut slider = commands.spawn_scene(bsn! {
                @FeathersSlider { @min: 0.0, @max: 1.0 }
                Slider { track_click: TrackClick::Snap }
                SliderValue({position})
                SliderStep({step})
                SliderPrecision(4)
            });
            slider.insert(Numbers(track)).id()
        }
        State::Value(Value::Choice { chosen, names: of }) => {
            let of: Vec<String> = of.iter().map(|name| spaced(name)).collect();
            let options = names(&of, *chosen);
            let mut select = commands.spawn_scene(bsn! {
                @FeathersSelect { @options: {options}, @max_visible: 10 }
                Node { flex_grow: 1.0 }
            });
            select.insert(Chosen(*chosen)).id()
        }
        State::Names(of, chosen) => {
            let options = names(of, *chosen);
            let mut select = commands.spawn_scene(bsn! {
                @FeathersSelect { @options: {options}, @max_visible: 10 }
                Node { flex_grow: 1.0 }
            });
            select.insert(Chosen(*chosen)).id()
        }
        State::Flag(flag) => {
            let mut switch = commands.spawn_scene(bsn! { @FeathersToggleSwitch });
            if *flag {
                switch.insert(Checked);
            }
            switch.id()
        }
        State::Button => {
            let text = line.label.clone();
            let button = commands.spawn_scene(bsn! {
                @FeathersButton { @caption: bsn! { @caption(text) } }
                Node { flex_grow: 1.0 }
            });
            button.id()
        }
    };
    commands
        .entity(widget)
        .insert((line.control.clone(), ChildOf(row)));
}

/// `GeometricScaled` as people write it.
fn spaced(name: &str) -> String {
    let mut text = String::new();
    for (index, letter) in name.chars().enumerate() {
        let begins = letter.is_uppercase() && index > 0 && !name.contains(' ');
        if begins {
            text.push(' ');
        }
        if begins {
            text.extend(letter.to_lowercase());
        } else {
            text.push(letter);
        }
    }
    text
}

fn shown_if(shown: bool) -> Visibility {
    if shown {
        Visibility::Inherited
    } else {
        Visibility::Hidden
    }
}

/// Widgets show what their controls hold, whoever set it.
fn follow_values(
    mut commands: Commands,
    shown: Res<Shown>,
    widgets: Query<(
        Entity,
        &Control,
        Option<(&SliderValue, &Numbers)>,
        Option<&Chosen>,
        Has<Checked>,
    )>,
    mut resets: Query<(&Reset, &mut Visibility)>,
    rows: Query<&OptionIndex>,
    children: Query<&Children>,
) {
    for (widget, control, number_now, chosen_now, checked) in &widgets {
        let Some(line) = shown.0.iter().find(|line| line.control == *control) else {
            continue;
        };
        match &line.state {
            State::Value(Value::Number { value, .. }) => {
                if let Some((now, Numbers(track))) = number_now {
                    let position = track.position(*value);
                    if (now.0 - position).abs() > 1e-4 {
                        commands.entity(widget).insert(SliderValue(position));
                    }
                }
            }
            State::Value(Value::Choice { chosen, .. }) | State::Names(_, chosen) => {
                if chosen_now.is_some_and(|now| now.0 != *chosen) {
                    commands.entity(widget).insert(Chosen(*chosen));
                    for entity in children.iter_descendants(widget) {
                        if let Ok(index) = rows.get(entity) {
                            if index.0 == *chosen {
                                commands.entity(entity).insert(Selected);
                            } else {
                                commands.entity(entity).remove::<Selected>();
                            }
                        }
                    }
                }
            }
            State::Flag(flag) if *flag != checked => {
                if *flag {
                    commands.entity(widget).insert(Checked);
                } else {
                    commands.entity(widget).remove::<Checked>();
                }
            }
            State::Flag(_) | State::None | State::Button => {}
        }
    }
    for (reset, mut visibility) in &mut resets {
        let line = shown.0.iter().find(|line| line.control == reset.0);
        visibility.set_if_neq(shown_if(line.is_some_and(|line| line.changed)));
    }
}

/// Sliders show their numbers, not where these lie.
fn write_numbers(
    shown: Res<Shown>,
    sliders: Query<(Entity, &Control), With<Numbers>>,
    children: Query<&Children>,
    mut texts: Query<&mut Text>,
) {
    for (slider, control) in &sliders {
        let line = shown.0.iter().find(|line| line.control == *control);
        let Some(State::Value(Value::Number { value, .. })) = line.map(|line| &line.state) else {
            continue;
        };
        for entity in children.iter_descendants(slider) {
            if let Ok(mut text) = texts.get_mut(entity) {
                text.set_if_neq(Text(in_digits(*value)));
            }
        }
    }
}

/// With four digits at least, and no zeros at the end.
fn in_digits(value: f32) -> String {
    let magnitude = value.abs().max(1e-6).log10().floor() as i32;
    let places = (3 - magnitude).clamp(0, 9) as usize;
    let text = format!("{value:.places$}");
    if places == 0 {
        return text;
    }
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Who has the keyboard is in view.
fn show_focused(
    mut commands: Commands,
    focus: Res<InputFocus>,
    mut last: Local<Option<Entity>>,
    nodes: Query<(), With<Node>>,
) {
    let focused = focus.get();
    if *last != focused {
        *last = focused;
        if let Some(entity) = focused.filter(|focused| nodes.contains(*focused)) {
            commands.trigger(ScrollIntoView { entity });
        }
    }
}

fn on_number(
    change: On<ValueChange<f32>>,
    controls: Query<(&Control, &Numbers)>,
    mut edits: MessageWriter<Edit>,
) {
    if let Ok((control, Numbers(track))) = controls.get(change.source) {
        let (control, to) = (control.clone(), To::Number(track.value(change.value)));
        edits.write(Edit { control, to });
    }
}

fn on_flag(
    change: On<ValueChange<bool>>,
    controls: Query<&Control>,
    mut edits: MessageWriter<Edit>,
) {
    if let Ok(control) = controls.get(change.source) {
        let (control, to) = (control.clone(), To::Flag(change.value));
        edits.write(Edit { control, to });
    }
}

fn on_choice(
    change: On<ValueChange<Entity>>,
    controls: Query<&Control>,
    rows: Query<&OptionIndex>,
    mut chosen: Query<&mut Chosen>,
    mut edits: MessageWriter<Edit>,
) {
    let (Ok(control), Ok(row)) = (controls.get(change.source), rows.get(change.value)) else {
        return;
    };
    if let Ok(mut chosen) = chosen.get_mut(change.source) {
        chosen.0 = row.0;
    }
    let (control, to) = (control.clone(), To::Choice(row.0));
    edits.write(Edit { control, to });
}

fn on_press(
    press: On<Activate>,
    buttons: Query<(Option<&Control>, Option<&Reset>)>,
    mut edits: MessageWriter<Edit>,
) {
    let edit = match buttons.get(press.entity) {
        Ok((_, Some(reset))) => Edit {
            control: reset.0.clone(),
            to: To::Default,
        },
        Ok((Some(control @ (Control::CopyRon | Control::SavePreset)), _)) => Edit {
            control: control.clone(),
            to: To::Next,
        },
        _ => return,
    };
    edits.write(edit);
}
