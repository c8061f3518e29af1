"""Exports bags as a LeRobot data set, version 3.0: frames at a fixed rate, an episode for each bag or each press.

Layout and names after huggingface/lerobot, `lerobot.datasets.utils` of release 0.4 (codebase version v3.0).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

from tactile_nodes.bag.compare import find_topic
from tactile_nodes.errors import ConfigurationError, DatasetError
from tactile_nodes.exporting.columns import IMAGE_TYPE
from tactile_nodes.exporting.episodes import BAG, Limit, count_outside, find_end, find_episodes, find_start
from tactile_nodes.exporting.features import EVENTS, Feature, features_of, png
from tactile_nodes.exporting.lerobot_files import Meta
from tactile_nodes.exporting.output import FACTS, write_json
from tactile_nodes.exporting.resampling import PREVIOUS, Episode, Frame, Resampler
from tactile_nodes.exporting.source import Source
from tactile_nodes.learning.progress import Bar, Progress


@dataclass(frozen=True)
class Plan:
    """How bags become frames. `state` and `action` are topics; empty `topics` means all observations."""

    fps: int = 30
    pick: str = PREVIOUS
    cut: str = BAG
    task: str = 'touch'
    robot: str = 'unknown'
    state: str = ''
    action: str = ''
    topics: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()
    images: bool = False

    def __post_init__(self) -> None:
        if not 1 <= self.fps <= 1000:
            raise ConfigurationError(f'--fps must be 1 to 1000, got {self.fps}')


def export_lerobot(
    bags: Sequence[Path],
    folder: Path,
    plan: Plan,
    facts: dict[str, Any],
    progress: Progress,
    over: Callable[[Source, Limit, Limit], None] = lambda _source, _start, _end: None,
) -> Meta:
    """Write a data set of `bags` into `folder`; `over` is called for each bag after it was read, with the places
    where its episodes could begin and end.

    Raises:
        ConfigurationError: pyarrow is not installed, or the plan names a topic that is no vector.
        BagError: a bag cannot be read or holds no forces.
        DatasetError: bags hold different features, or there is no frame in any.
    """
    meta = Meta(folder, plan.fps, plan.task, plan.robot)
    sources = []
    for path in bags:
        with Source(path, plan.topics, plan.exclude, images=plan.images) as source:
            start, end, outside = _export_bag(source, meta, plan, facts, progress)
            sources.append({
                **source.facts(),
                'force_messages_outside_episodes': outside,
                'left_out_at_start_s': start.skipped_s,
                'begins_with': start.topic,
                'left_out_at_end_s': end.skipped_s,
                'ends_with': end.topic,
            })  # fmt: skip
            over(source, start, end)
    if not meta.frames:
        raise DatasetError(f'there is no frame in {", ".join(map(str, bags))}; nothing was exported')
    all_facts = {
        **facts,
        'resampling': f'{plan.pick} message by its stamp, its age in age_s.* [s]; none: NaN',
        'units': {feature.key: _units(feature) for feature in meta.features if any(feature.units)},
        'bags': sources,
    }
    meta.close(all_facts)
    write_json(folder / FACTS, all_facts)
    return meta


def _export_bag(
    source: Source, meta: Meta, plan: Plan, facts: dict[str, Any], progress: Progress
) -> tuple[Limit, Limit, dict[str, int]]:
    _leave_out(source, plan)
    state, action = _full_name(source, '--state', plan.state), _full_name(source, '--action', plan.action)
    features = features_of(list(source.layouts.values()), state, action)
    start = find_start(source, {feature.topic for feature in features})
    end = find_end(source)
    episodes = find_episodes(source, plan.cut, plan.exclude, start, end)
    meta.agree(features, _texts(source, features), source.bag.path)
    with progress.bar(f'exporting {source.bag.path.name}', source.count) as bar:
        for number, frames in groupby(_frames(source, episodes, plan, bar), lambda frame: frame.episode):
            file = meta.open_episode()
            for frame in frames:
                values = {feature.key: _value(feature, frame) for feature in meta.features}
                file.take(frame.number, frame.stamp_ns, values)
            details = {'bag': source.bag.path.resolve().name, **episodes[number].details}
            meta.close_episode(file, details, {**facts, **source.facts()})
    return start, end, _outside(source, episodes)


def _frames(source: Source, episodes: list[Episode], plan: Plan, bar: Bar) -> Iterator[Frame]:
    """Each frame once it is complete."""
    resampler = Resampler(list(source.layouts), episodes, plan.fps, plan.pick)
    horizon = source.horizon(min((each.start_ns for each in episodes), default=0))
    for stamped in source.messages(bar):
        row = source.layouts[stamped.topic].row(stamped.message)
        yield from resampler.take(stamped.topic, stamped.stamp_ns, horizon.at(stamped.received_ns), row)
    yield from resampler.finish()


def _value(feature: Feature, frame: Frame) -> Any:
    value = feature.value(frame.picked[feature.topic])
    return png(value) if feature.is_image else value


def _units(feature: Feature) -> str | list[str]:
    """The common unit of all components, or the unit of each."""
    return feature.units[0] if len(set(feature.units)) == 1 else list(feature.units)


def _leave_out(source: Source, plan: Plan) -> None:
    """Leave out events that are not wanted, and pictures that a data set cannot hold, as a `force_map` in newtons."""
    for topic, layout in source.layouts.items():
        if not plan.topics and topic.rpartition('/')[2] in EVENTS:
            source.left_out[topic] = 'not an observation; add it with --topics'
        elif layout.type_name == IMAGE_TYPE:
            kind = next(each.dtype for each in layout.columns if each.name == 'pixels')
            if kind != 'uint8':
                reason = f'pictures of {kind} do not fit into the 8 bits of a data set; zarr holds them'
                source.left_out[topic] = reason
    source.layouts = {topic: layout for topic, layout in source.layouts.items() if topic not in source.left_out}


def _texts(source: Source, features: list[Feature]) -> dict[str, list[str]]:
    """What numbers of the features mean, such as joint names, by field and topic."""
    topics = sorted({feature.topic for feature in features})
    fields = [(topic, name, texts) for topic in topics for name, (_, texts) in source.layouts[topic].constant.items()]
    return {f'{name} of {topic}': texts for topic, name, texts in fields}


def _full_name(source: Source, flag: str, topic: str) -> str:
    name = find_topic(source.bag, topic) if topic else ''
    if name and name not in source.layouts:
        reason = source.left_out.get(name, 'not requested')
        raise ConfigurationError(
            f'{flag} {name} of {source.bag.path} is not exported ({reason}); exported are {", ".join(source.layouts)}'
        )
    return name


def _outside(source: Source, episodes: list[Episode]) -> dict[str, int]:
    """The number of force messages outside all episodes, by topic."""
    return {
        topic: count_outside(source.stamps_ns(topic), episodes)
        for topic, layout in source.layouts.items()
        if layout.is_force
    }
