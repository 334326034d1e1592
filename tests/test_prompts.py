"""The corpus of commands: understood as meant, balanced, and split without leaks."""

from __future__ import annotations

from collections import Counter, defaultdict

import numpy as np
import pytest

from robomirror_drake.dataset.corpus import make_corpus
from robomirror_drake.dataset.grammar import Meaning, grammar, matches, phrases, propose, understood
from robomirror_drake.dataset.prompts import Prompt, read_prompts, write_prompts
from robomirror_drake.dataset.wording import finite_phrases, gerund, gerund_phrase
from robomirror_drake.exceptions import InputError
from robomirror_drake.motion.library import library


@pytest.mark.parametrize(
    ("verb", "form"),
    [
        ("claps", "clapping"),
        ("waves", "waving"),
        ("nods", "nodding"),
        ("stretches", "stretching"),
        ("boxes", "boxing"),
        ("goes", "going"),
        ("carries", "carrying"),
        ("lies", "lying"),
        ("raises", "raising"),
        ("points", "pointing"),
        ("bows", "bowing"),
        ("agrees", "agreeing"),
        ("crosses", "crossing"),
        ("hugs", "hugging"),
    ],
)
def test_forms_of_verbs(verb, form):
    assert gerund(verb) == form


def test_phrases():
    assert gerund_phrase("very slowly waves the left hand") == "very slowly waving the left hand"
    assert gerund_phrase("is nodding") == "nodding"
    sentences = ["a person walks on", "walking on", "she kicks (a recorded motion)", "he walks on"]
    assert list(finite_phrases(sentences)) == ["walks on", "kicks"]


def test_the_grammar_speaks_of_the_library():
    said, actions = grammar(), library()
    named = {name for name in said.slots if name not in ("locomotion", "dynamic", "expressive")}
    assert named <= actions.keys()
    assert {name for family in said.held_out.values() for name in family} <= actions.keys()
    assert {kind for kinds in said.slots.values() for kind in kinds} <= said.modifiers.keys()
    assert said.modifiers.keys() == said.fields.keys()


def test_most_proposals_are_understood_as_they_are_meant():
    """All clauses, sides, counts, speeds, sizes, angles and distances."""
    names = tuple(library())[::8]
    known, rng = phrases(names), np.random.default_rng(3)
    assert tuple(known) == names
    proposals = [propose(names[i], known, rng) for i in rng.integers(len(names), size=60)]
    right = sum(matches(understood(made.text), made.meaning) for made in proposals)
    assert right >= 0.75 * len(proposals)


def test_meanings_are_told_apart():
    assert not matches(None, (Meaning("walk"),))
    assert matches((Meaning("turn", angle=np.pi / 2),), (Meaning("turn", angle=1.570796),))
    assert not matches((Meaning("wave", side="left"),), (Meaning("wave", side="right"),))
    assert not matches((Meaning("wave", side="left"),), (Meaning("wave"),))
    assert not matches((Meaning("wave"), Meaning("bow")), (Meaning("bow"), Meaning("wave")))
    # Tempo and size are compared where they are meant.
    assert matches((Meaning("wave", tempo="less"),), (Meaning("wave"),))
    assert not matches((Meaning("wave", tempo="less"),), (Meaning("wave", tempo="more"),))
    assert not matches((Meaning("wave"),), (Meaning("wave", amplitude="less"),))


def test_a_small_corpus_is_the_same_again():
    corpus = make_corpus(140, seed=4, actions=tuple(library())[::8])
    texts = [prompt.text for prompt in corpus.prompts]
    assert len(set(texts)) == 140
    assert len(corpus.lost) <= 5
    assert {prompt.origin for prompt in corpus.prompts} == {"grammar", "hand"}
    assert make_corpus(140, seed=4, actions=tuple(library())[::8]).prompts == corpus.prompts


@pytest.fixture(scope="module")
def shipped() -> tuple[Prompt, ...]:
    return read_prompts("corpus")


def test_the_corpus_is_large_and_balanced(shipped):
    assert len(shipped) >= 8500
    groups = Counter(prompt.group for prompt in shipped)
    assert groups.keys() == {"locomotion", "dynamic", "expressive"}
    assert max(groups.values()) < 1.05 * min(groups.values())
    first = Counter(prompt.actions[0] for prompt in shipped)
    assert first.keys() == library().keys()
    assert min(first.values()) >= 40
    assert sum(prompt.origin == "hand" for prompt in shipped) >= 100


def test_splits_do_not_leak(shipped):
    splits = Counter(prompt.split for prompt in shipped)
    learned = sum(splits.values()) - splits["held_out"]
    assert splits["validation"] > 0.08 * learned
    assert splits["test"] > 0.08 * learned
    assert splits["held_out"] > 500
    for prompt in shipped:
        families = {grammar().family(action) for action in prompt.actions} - {""}
        assert (prompt.split == "held_out") == bool(families)
        assert not families or prompt.family in families
    assert {prompt.family for prompt in shipped} == {"", *grammar().held_out}


def test_a_sample_of_the_corpus_is_understood_as_it_says(shipped):
    """Nearly all: how words are understood may be mended without writing the corpus anew."""
    rng = np.random.default_rng(0)
    splits, lost = defaultdict(set), []
    for index in rng.choice(len(shipped), size=60, replace=False):
        prompt = shipped[index]
        meaning = understood(prompt.text)
        if meaning is None or tuple(clause.action for clause in meaning) != prompt.actions:
            lost.append(prompt.text)
        else:
            splits[meaning].add(prompt.split)
    assert len(lost) <= 3, lost
    assert all(len(found) == 1 for found in splits.values())


def test_files_of_prompts(tmp_path):
    prompts = (
        Prompt(text='a person says "hi", and waves', split="test", actions=("wave", "walk")),
        Prompt(text="a person walks", group="locomotion", origin="hand"),
    )
    write_prompts(tmp_path / "p.csv", prompts)
    assert read_prompts(tmp_path / "p.csv") == prompts
    (tmp_path / "p.txt").write_text("a person walks\n\na person waves\n")
    assert [prompt.text for prompt in read_prompts(tmp_path / "p.txt")] == [
        "a person walks",
        "a person waves",
    ]


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("p.txt", "\n", "no commands"),
        ("p.txt", "a\na\n", "twice"),
        ("p.csv", "text,split\na,exam\n", "split"),
        ("p.csv", "text,colour\na,red\n", "colour"),
        ("q.csv", None, "q.csv"),
        ("nonesuch", None, "no prompts 'nonesuch'; known: corpus"),
    ],
)
def test_bad_files_of_prompts_are_refused(tmp_path, monkeypatch, name, content, message):
    monkeypatch.chdir(tmp_path)
    if content is not None:
        (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=message):
        read_prompts(name)


def test_a_folder_does_not_stand_in_the_way_of_a_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "falls").mkdir()
    assert len(read_prompts("falls")) > 400
