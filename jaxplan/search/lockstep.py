"""Searches as generators that ask for kernel calls, so that one of them or many in lockstep can run.

A search yields a `Call` wherever it needs a jitted kernel, and is sent the kernel's answer as one numpy
array. `alone` answers the calls of one search one by one. `together` runs many: it always answers the calls
that most searches wait for, up to `CALLS` of them in one. Each search sees the same answers to the last
bit either way: on the CPU the calls are a loop over the very code of the single one, which saves what a call
costs by itself and leaves nothing to the batch's size. On an accelerator they are computed side by side,
where last bits may differ.
"""

from collections import defaultdict
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxplan.display import shown
from jaxplan.runtime.stopwatch import working_time
from jaxplan.search.problem import Scene

# Calls in one, and scenes that run in lockstep: fixed, so that the kernels compile once.
CALLS, POOL = 32, 256

T = TypeVar("T")


class Kernel:
    """A function of (scene, arrays ..., gate) that answers with one array, jitted for one or many calls.

    It is pure; the gate is that of `motions.computed_once`.
    """

    def __init__(self, function: Callable[..., Array]) -> None:
        self._one = jax.jit(function)
        self._many = jax.jit(partial(_many, function), static_argnames="abreast")

    def __call__(self, scene: Scene, *arguments: Any) -> np.ndarray:
        """The answer for one scene."""
        return np.asarray(self._one(scene, *arguments, True))

    def many(
        self, scenes: Scene, places: np.ndarray, count: int, arguments: Sequence[np.ndarray]
    ) -> np.ndarray:
        """The answers for several scenes.

        Args:
            scenes: stacked, on the device.
            places: (CALLS,) which scene each call is about.
            count: how many of the calls count.
            arguments: of the calls, stacked (CALLS, ...).

        Returns:
            (CALLS, ...), of which the first `count` hold answers.
        """
        abreast = jax.default_backend() != "cpu"
        return np.asarray(self._many(scenes, places, count, True, *arguments, abreast=abreast))


def _many(
    function: Callable[..., Array],
    scenes: Scene,
    places: Array,
    count: Array,
    gate: Array,
    *arguments: Array,
    abreast: bool,
) -> Array:
    def one(call: Array) -> Array:
        scene = jax.tree.map(lambda leaf: leaf[places[call]], scenes)
        return function(scene, *(argument[call] for argument in arguments), gate)

    if abreast:
        return jax.vmap(one)(jnp.arange(places.shape[0]))
    shape = jax.eval_shape(one, 0)
    blank = jnp.zeros((places.shape[0], *shape.shape), shape.dtype)
    return jax.lax.fori_loop(0, count, lambda call, answers: answers.at[call].set(one(call)), blank)


@shown()
@dataclass(frozen=True, slots=True, eq=False)
class Call:
    """What a search asks for.

    Attributes:
        kernel: to be called about the search's scene.
        arguments: numpy arrays or floats between scene and gate.
    """

    kernel: Kernel
    arguments: tuple[Any, ...]


Steps = Generator[Call, np.ndarray, T]


def alone(scene: Scene, steps: Steps[T]) -> T:
    """What one search returns, its calls answered one by one."""
    device = scene.on_device
    with jax.enable_x64(True):
        try:
            call = next(steps)
            while True:
                call = steps.send(call.kernel(device, *call.arguments))
        except StopIteration as end:
            return end.value


def together(
    scenes: Sequence[Scene], searches: Sequence[Steps[T]], spent: np.ndarray | None = None
) -> list[T]:
    """What many searches return, their calls answered together.

    Args:
        scenes: of each search.
        searches: that have not begun.
        spent: (n,) to which the seconds of each search are added, without those of compiling: of calls
            answered together an equal share.
    """
    seconds = np.zeros(len(scenes)) if spent is None else spent
    alike: dict[Any, list[int]] = defaultdict(list)
    for number, scene in enumerate(scenes):
        alike[_layout(scene)].append(number)
    answers: dict[int, T] = {}
    with jax.enable_x64(True):
        for numbers in alike.values():
            for begin in range(0, len(numbers), POOL):
                pool = numbers[begin : begin + POOL]
                stacked = _stack([scenes[number] for number in pool])
                found, took = _run(stacked, [searches[number] for number in pool])
                answers.update(zip(pool, found, strict=True))
                seconds[pool] += took
    return [answers[number] for number in range(len(scenes))]


def _layout(scene: Scene) -> tuple[Any, ...]:
    """What scenes must share to be stacked."""
    return tuple(np.shape(leaf) for leaf in jax.tree.leaves(scene))


def _stack(scenes: list[Scene]) -> Scene:
    """Scenes as one with POOL of everything, the first repeated, on the device."""
    full = scenes + scenes[:1] * (POOL - len(scenes))
    columns = zip(*(jax.tree.leaves(scene) for scene in full), strict=True)
    stacked = [np.stack(column) for column in columns]
    return jax.device_put(jax.tree.unflatten(jax.tree.structure(scenes[0]), stacked))


def _run(scenes: Scene, searches: list[Steps[T]]) -> tuple[list[T], np.ndarray]:
    """Run searches whose scenes are stacked to their ends; with their answers the seconds of each."""
    answers: dict[int, T] = {}
    took = np.zeros(len(searches))
    waiting: dict[Any, list[tuple[int, Call]]] = defaultdict(list)

    def go_on(number: int, answer: np.ndarray | None) -> None:
        began = working_time()
        try:
            call = searches[number].send(answer)  # type: ignore[arg-type]  # None begins
        except StopIteration as end:
            took[number] += working_time() - began
            answers[number] = end.value
        else:
            took[number] += working_time() - began
            waiting[call.kernel, *(np.shape(argument) for argument in call.arguments)].append((number, call))

    for number in range(len(searches)):
        go_on(number, None)
    while waiting:
        most = max(waiting, key=lambda kind: len(waiting[kind]))
        calls = waiting.pop(most)
        now, later = calls[:CALLS], calls[CALLS:]
        if later:
            waiting[most] = later
        began = working_time()
        given = _answers(scenes, now)
        took[[number for number, _ in now]] += (working_time() - began) / len(now)
        for (number, _), answer in zip(now, given, strict=False):
            go_on(number, answer)
    return [answers[number] for number in range(len(searches))], took


def _answers(scenes: Scene, calls: list[tuple[int, Call]]) -> np.ndarray:
    """The answers of calls of one kernel with arguments of the same shapes."""
    padded = calls + calls[:1] * (CALLS - len(calls))
    places = np.array([number for number, _ in padded], np.int32)
    arguments = [np.stack(column) for column in zip(*(call.arguments for _, call in padded), strict=True)]
    return calls[0][1].kernel.many(scenes, places, len(calls), arguments)
