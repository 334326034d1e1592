"""How well commands are understood: written sentences, and a thousand like captions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from robomirror_drake.exceptions import InputError, UnknownCommandError
from robomirror_drake.motion.language import intent, train
from robomirror_drake.motion.language.classifier import UNKNOWN, classifier
from robomirror_drake.motion.language.fragments import SUBJECT
from robomirror_drake.motion.library import library
from robomirror_drake.motion.text import parse

DATA = Path(__file__).parent / "data"
SUBJECTS = ("a person", "the man", "someone", "a woman", "the figure", "he", "she", "this person")
CONNECTORS = (" and then ", ", then ", " then ", " and ", ", and then ", " before ")
COUNTED = {"": None, "twice": 2, "three times": 3}


def load(name: str) -> Any:
    return yaml.safe_load((DATA / name).read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("source", "least"),
    [(intent.PACKAGED, 0.95), (str(DATA / "sentences_development.yaml"), 0.98)],
)
def test_written_sentences(source: str, least: float) -> None:
    """All clauses, their order, side and count."""
    found = intent.accuracy(intent.load_sentences(source))
    assert found["accuracy"] >= least, "\n".join(row["text"] for row in found["wrong"])


def test_accuracy_tells_right_wrong_and_refused() -> None:
    rows = [
        ("a person bows twice", "bow x2"),
        ("a person bows twice", "bow"),
        ("a person plays the violin", "bow"),
        ("he walks forward while waving the left hand", "walk + wave left"),
        ("he walks forward while waving the left hand", "walk > wave left|wave left"),
        ("turn left by 90 degrees", "turn left @90"),
        ("turn left by 90 degrees", "turn left @180"),
    ]
    found = intent.accuracy(rows)
    assert [row["meant"] for row in found["wrong"]] == [rows[i][1] for i in (1, 2, 4, 6)]
    assert (found["right"], found["refused"]) == (3, 1)
    assert found["kinds"]["with side"] == {"sentences": 4, "right": 2}
    assert [row["read"] for row in found["wrong"]][-2:] == ["walk + wave left", "turn left @90"]


@pytest.mark.parametrize(
    ("content", "message"),
    [("- [a, b", "not YAML"), ("a: b", "no list"), ("- [bow]", "entry 1"), (None, "no file")],
)
def test_a_file_that_holds_no_sentences(tmp_path: Path, content: str | None, message: str) -> None:
    path = tmp_path / "sentences.yaml"
    if content is not None:
        path.write_text(content)
    with pytest.raises(InputError, match=message):
        intent.load_sentences(str(path))


def test_what_is_unknown_is_refused() -> None:
    sentences = load("sentences_unknown.yaml")
    accepted = [text for text in sentences if not refused(text)]
    assert len(accepted) <= 0.1 * len(sentences), "\n".join(accepted)


def refused(text: str) -> bool:
    """Whether a sentence is refused, naming the nearest actions where none is known."""
    try:
        parse(text)
    except UnknownCommandError as error:
        return len(error.nearest) == 3
    except InputError:
        return True
    return False


def drawn(rng: np.random.Generator, bank: dict[str, Any]) -> tuple[str, list[Any]]:
    """A sentence of one to three clauses, and what each means; [] where one is unknown."""
    number = int(rng.choice([1, 2, 3], p=[0.5, 0.38, 0.12]))
    text, meaning, unknown = f"{rng.choice(SUBJECTS)} ", [], False
    connectors = [str(c) for c in rng.choice(CONNECTORS[:5], number)]
    for i in range(number):
        if rng.random() < 0.05:
            phrase, clause = str(rng.choice(bank["unknown"])), None
            unknown = True
        else:
            choice = [row for row in bank["known"] if row[1] not in [m[0] for m in meaning if m]]
            template, action = choice[rng.integers(len(choice))]
            side = str(rng.choice(["left", "right"])) if "{side}" in template else None
            times = str(rng.choice(list(COUNTED))) if "{times}" in template else ""
            phrase = template.format(
                side=side, times=times, steps="three " * ("{steps}" in template)
            )
            phrase = phrase.replace("walks three forward", "walks three steps forward").strip()
            count = COUNTED[times] or (3 if "three steps" in phrase else None)
            clause = (action, side, count)
        text += (connectors[i] if i else "") + phrase
        meaning.append(clause)
    return text, [] if unknown else meaning


def test_a_thousand_sentences_in_the_style_of_captions() -> None:
    """No crash; few are refused without need; next to none silently becomes something else."""
    bank, rng = load("phrases.yaml"), np.random.default_rng(7)
    captions = load("sentences_style.yaml")
    sentences = [drawn(rng, bank) for _ in range(1000 - len(captions))]
    needless, wrong = [], []
    for text, meaning in sentences:
        try:
            got = [(c.action, c.side, c.count) for c in parse(text)]
        except InputError:
            needless += [text] if meaning else []
            continue
        if not same_actions(got, meaning):
            wrong.append(f"{text!r}: {got}, not {meaning}")
    for text, meaning in captions:
        alternatives = meaning if any(isinstance(m, list) for m in meaning) else [meaning]
        try:
            got_actions = [c.action for c in parse(text)]
        except InputError:
            needless += [] if [] in alternatives else [text]
            continue
        if got_actions not in alternatives:
            wrong.append(f"{text!r}: {got_actions}, not {meaning}")
    assert len(needless) <= 5, "\n".join(needless)
    assert len(wrong) <= 5, "\n".join(wrong)


def same_actions(got: list[Any], meaning: list[Any]) -> bool:
    return len(got) == len(meaning) and all(
        g[0] == m[0] and (m[1] is None or g[1] == m[1]) and g[2] == m[2]
        for g, m in zip(got, meaning, strict=True)
    )


def test_the_classifier_is_trained_on_the_phrases_as_they_are() -> None:
    """Else: python -m robomirror_drake.motion.language.train."""
    assert classifier().names == (*library(), UNKNOWN)
    assert classifier().digest == train.digest(*train.corpus())


def test_softmax_regression_is_at_its_optimum() -> None:
    rng = np.random.default_rng(0)
    vectors, labels = rng.normal(size=(40, 5)), rng.integers(0, 3, 40)
    weight, bias = train.fit(vectors, labels, 3)
    logits = vectors @ weight.T + bias
    p = np.exp(logits - logits.max(axis=1, keepdims=True))
    p /= p.sum(axis=1, keepdims=True)
    target = np.eye(3)[labels]
    share = np.minimum(1.0 / (3 * target.mean(axis=0)), 1.0)[labels]
    gradient = ((p - target) * share[:, None]).T @ vectors / 40 + 2 * train.RIDGE / 3 * weight
    assert np.abs(gradient).max() < 1e-4


def test_no_sentence_held_apart_is_a_phrase_of_the_library() -> None:
    phrases = {phrase for action in library().values() for phrase in action.phrases}
    held_apart = {text for text, _ in intent.load_sentences()}
    assert len(held_apart) == 400
    assert not (held_apart | {SUBJECT.sub("", text) for text in held_apart}) & phrases
