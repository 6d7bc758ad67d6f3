"""Batches: filtered in time as shots are, and kept in files where they are long."""

import gc
from pathlib import Path

import numpy as np
import pytest

import relight
from relight.comfyui import subjects
from relight.comfyui.subjects import SubjectBatch, each_person


class Frame(relight.Subject):
    """Stands in for the subject of a frame: knows its number and what it was filtered with."""

    camera, is_empty = None, False

    def __init__(self, number, first=None):
        self.number, self.first, self.others = number, first, None

    def temporally_filtered(self, around):
        filtered = Frame(self.number)
        filtered.others = sorted(other.number for other in around)
        return filtered


def test_frames_of_a_shot_are_filtered_with_two_on_either_side():
    made = []

    def analyse(number, first):
        made.append(number)
        return relight.Subject.nobody((4, 4)) if number == 3 else Frame(number, first)

    people = list(each_person(6, analyse, is_shot=True))
    assert made == [0, 1, 2, 3, 4, 5]
    filtered = [person.others for _, person in people if isinstance(person, Frame)]
    assert filtered == [[1, 2], [0, 2], [0, 1, 4], [2, 5], [4]]
    assert people[3][1].is_empty
    assert people[5][0].first is people[0][0]  # whose room it shares


def test_a_single_picture_and_separate_ones_are_not_filtered():
    ((analysed, person),) = each_person(1, Frame, is_shot=True)
    assert analysed is person
    separate = [person for _, person in each_person(2, Frame, is_shot=False)]
    assert [(person.number, person.first) for person in separate] == [(0, None), (1, None)]


@pytest.fixture(scope="module")
def subject(viewed):
    return viewed


def test_a_long_batch_is_kept_in_files_that_go_with_it(subject, monkeypatch):
    monkeypatch.setattr(subjects, "IN_MEMORY", 1)
    empty = relight.Subject.nobody(subject.size)
    batch = SubjectBatch(2, iter([(empty, empty), (subject, subject)]))
    folder = Path(batch._folder.name)
    assert len(list(folder.iterdir())) == len(batch) == 2
    assert batch.shown is subject
    assert batch.size == subject.size
    assert batch[0].is_empty
    light = relight.DirectionalLight(azimuth=40)
    error = np.sqrt(np.mean((batch[1].relit(light) - subject.relit(light)) ** 2))
    assert 0 < error < 0.003
    del batch
    gc.collect()
    assert not folder.exists()


def test_a_single_subject_stands_for_all_frames(subject):
    batch = SubjectBatch(1, iter([(subject, subject)]))
    assert batch[0] is batch[17] is subject
    assert list(batch) == [subject]
