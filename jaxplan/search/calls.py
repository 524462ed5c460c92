"""Kernel calls about one scene or many, and the runs that wait for them.

A `Kernel` is a jitted function of a scene and some arrays. `Scenes` are scenes of equal shapes, stacked on
the device, so that calls about different scenes are answered in one. Whatever has queues or trees is a
`jaxplan.runtime.batching.Run` that asks for one `Call` after the other; `Scenes.run` drives one of each
scene.

On the CPU the calls of a batch are a loop over the code of the single one, which saves what a call costs by
itself and keeps its working set in the cache. On an accelerator they are computed side by side, where last
digits may differ.
"""

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.runtime.batching import Run, Seconds, in_groups, run_all
from jaxplan.runtime.display import shown
from jaxplan.runtime.jit import quick_jit
from jaxplan.search.problem import Scene

# Calls that are answered in one: on the CPU few, since few mostly wait and room for more takes time; on an
# accelerator as many as it computes side by side without taking longer. Fixed, so that kernels compile once.
CPU_CALLS, ACCELERATOR_CALLS = 8, 32
# Scenes that are stacked, fixed likewise.
POOL = 256

Item = TypeVar("Item")
Answer = TypeVar("Answer")


def most_calls() -> int:
    """Calls that are answered in one on JAX's default device."""
    return CPU_CALLS if jax.default_backend() == "cpu" else ACCELERATOR_CALLS


class Kernel:
    """A pure function of (scene, arrays ..., gate) that answers with one array, jitted for one or many calls.

    The gate is that of `motions.computed_once`.
    """

    def __init__(self, function: Callable[..., Array]) -> None:
        self._one = quick_jit(function)
        self._many = quick_jit(partial(_many, function), static_argnames="vectorized")

    def __call__(self, scene: Scene, *arguments: Any) -> np.ndarray:
        """The answer for one scene, which is on the device."""
        return np.asarray(self._one(scene, *arguments, True))

    def many(
        self, scenes: Scene, places: np.ndarray, count: int, arguments: Sequence[np.ndarray]
    ) -> np.ndarray:
        """The answers for several scenes.

        Args:
            scenes: stacked, on the device.
            places: (`most_calls`,) which scene each call is about.
            count: how many of the calls count.
            arguments: of the calls, stacked likewise.

        Returns:
            As many answers, of which the first `count` count.
        """
        vectorized = jax.default_backend() != "cpu"
        return np.asarray(self._many(scenes, places, count, True, *arguments, vectorized=vectorized))


def _many(
    function: Callable[..., Array],
    scenes: Scene,
    places: Array,
    count: Array,
    gate: Array,
    *arguments: Array,
    vectorized: bool,
) -> Array:
    def one(call: Array) -> Array:
        scene = jax.tree.map(lambda leaf: leaf[places[call]], scenes)
        return function(scene, *(argument[call] for argument in arguments), gate)

    if vectorized:
        return jax.vmap(one)(jnp.arange(places.shape[0]))
    shape = jax.eval_shape(one, 0)
    blank = jnp.zeros((places.shape[0], *shape.shape), shape.dtype)
    return jax.lax.fori_loop(0, count, lambda call, answers: answers.at[call].set(one(call)), blank)


@shown()
@dataclass(frozen=True, slots=True, eq=False)
class Call:
    """A kernel call about some scene.

    Attributes:
        kernel: to be called.
        arguments: numpy arrays or floats between scene and gate.
    """

    kernel: Kernel
    arguments: tuple[Any, ...]

    @property
    def kind(self) -> Hashable:
        """The kernel and the shapes of its arguments: calls that share these are answered in one."""
        return self.kernel, tuple(np.shape(argument) for argument in self.arguments)


class SearchRun(Run, Protocol):
    """A search that goes on call by call, and knows its result at its end."""

    def result(self) -> Any:
        """The `SearchResult`, once there is no next request."""


class Scenes:
    """Scenes of equal shapes, with the answers of kernels about them and the time that each has taken.

    Attributes:
        scenes: some of those that are stacked, in the order in which answers are given.
        seconds: that each of all that are stacked has taken.
    """

    def __init__(self, scenes: Sequence[Scene]) -> None:
        self.scenes = list(scenes)
        self.seconds = Seconds(len(scenes))
        self._places = list(range(len(scenes)))
        self._stack = _Stack(self.scenes)

    def __len__(self) -> int:
        return len(self.scenes)

    def part(self, numbers: Sequence[int]) -> "Scenes":
        """Some of the scenes, sharing stack and seconds with all."""
        some = object.__new__(Scenes)
        some.scenes, some._places = picked(self.scenes, numbers), picked(self._places, numbers)
        some.seconds, some._stack = self.seconds, self._stack
        return some

    def answers(self, calls: Sequence[Call]) -> list[np.ndarray]:
        """The answers to one call about each scene; to each scene its share of the time is added."""
        asked = list(zip(self._places, calls, strict=True))
        with jax.enable_x64(True), self.seconds.shared(self._places):
            if len(asked) == 1:  # alike by itself
                return self._stack.answers(asked)
            return in_groups(asked, lambda one: one[1].kind, self._stack.answers, most=most_calls())

    def run(self, runs: Sequence[Run]) -> None:
        """Drive one run of each scene to its end."""
        with jax.enable_x64(True):
            if len(runs) == 1:  # needs no order of calls, nor to share out the time
                with self.seconds.shared(self._places):
                    while (call := runs[0].next_request()) is not None:
                        runs[0].accept(self._stack.answers([(self._places[0], call)])[0])
                return
            own = Seconds(len(runs))
            run_all(runs, self._answers_of, most=most_calls(), seconds=own)
            self.seconds.spent[self._places] += own.spent

    def _answers_of(self, numbers: Sequence[int], calls: Sequence[Call]) -> list[np.ndarray]:
        """The answers to calls of one kind about the scenes of these numbers."""
        return self._stack.answers(list(zip(picked(self._places, numbers), calls, strict=True)))


class _Stack:
    """Scenes as the kernels take them: one as it is, several as arrays of `POOL` scenes."""

    def __init__(self, scenes: Sequence[Scene]) -> None:
        self._scenes = scenes
        self._stacked: Scene | None = None

    def answers(self, calls: Sequence[tuple[int, Call]]) -> list[np.ndarray]:
        """The answers to at most `most_calls` of one kind, each with the number of its scene."""
        if len(self._scenes) == 1:
            scene = self._scenes[0].on_device
            return [call.kernel(scene, *call.arguments) for _, call in calls]
        if self._stacked is None:
            self._stacked = _stacked(self._scenes)
        padded = [*calls, *[calls[0]] * (most_calls() - len(calls))]
        places = np.array([number for number, _ in padded], np.int32)
        columns = zip(*(call.arguments for _, call in padded), strict=True)
        arguments = [np.stack(column) for column in columns]
        return list(calls[0][1].kernel.many(self._stacked, places, len(calls), arguments)[: len(calls)])


def _stacked(scenes: Sequence[Scene]) -> Scene:
    """Scenes as one with POOL of everything, the first repeated, on the device."""
    full = [*scenes, *[scenes[0]] * (POOL - len(scenes))]
    columns = zip(*(jax.tree.leaves(scene) for scene in full), strict=True)
    stacked = [np.stack(column) for column in columns]
    return jax.device_put(jax.tree.unflatten(jax.tree.structure(scenes[0]), stacked))


def layout(scene: Scene) -> tuple[Any, ...]:
    """Tree structure and shapes of a scene: scenes that share them can be stacked."""
    leaves, structure = jax.tree.flatten(scene)
    return structure, *(np.shape(leaf) for leaf in leaves)


def picked(items: Sequence[Item], numbers: Sequence[int]) -> list[Item]:
    """The items of these numbers."""
    return [items[number] for number in numbers]


def completed(
    answers: Sequence[Answer | None], answer: Callable[[list[int]], Sequence[Answer]]
) -> list[Answer]:
    """Answers, those that are None being asked for together.

    Args:
        answers: so far.
        answer: from the numbers of the missing ones, at least one, to as many answers.
    """
    missing = [number for number, one in enumerate(answers) if one is None]
    further = dict(zip(missing, answer(missing), strict=True)) if missing else {}
    return [further[number] if one is None else one for number, one in enumerate(answers)]
