import numpy as np
import pytest

from lookonce.output.labels import TextMasks, place_labels, plain_ascii

SIZE = (100, 200)


def _places(boxes, sizes) -> list[list[int]]:
    boxes, sizes = np.array(boxes, np.int64).reshape(-1, 4), np.array(sizes, np.int64).reshape(-1, 2)
    return place_labels(boxes, sizes, SIZE, np.arange(len(boxes))).tolist()


@pytest.mark.parametrize(
    ("box", "label", "place"),
    [
        pytest.param([50, 40, 90, 80], (10, 30), [50, 30], id="above"),
        pytest.param([50, 5, 90, 80], (10, 30), [50, 80], id="below when the top has no room"),
        pytest.param([50, 0, 90, 100], (10, 30), [50, 0], id="inside when nothing else is left"),
        pytest.param([180, 40, 200, 80], (10, 30), [170, 30], id="moved in from the right border"),
        pytest.param([180, 0, 200, 20], (10, 30), [170, 20], id="top right corner"),
        pytest.param([50, 40, 90, 80], (10, 300), [0, 30], id="wider than the picture"),
        pytest.param([50, 40, 90, 80], (200, 300), [0, 0], id="larger than the picture"),
    ],
)
def test_label_finds_its_place(box, label, place):
    assert _places([box], [label]) == [place]


def test_labels_keep_off_each_other():
    first, second = _places([[50, 40, 70, 80], [60, 42, 80, 82]], [(10, 40), (10, 40)])
    assert first == [50, 30]
    assert second[1] >= 80


def test_no_labels_have_no_places():
    assert _places([], []) == []


@pytest.mark.parametrize("font_px", [10, 14, 22, 40])
def test_all_texts_of_a_size_are_equally_high_and_have_ink_within_their_margins(font_px):
    texts = TextMasks(font_px)
    for text in ("person 1", "0.87", "Ägypten gjpqy", "自転車", ""):
        mask = texts(text)
        assert mask.shape[0] == texts.height
        assert mask.dtype == np.uint8
    figures = texts("0.87")
    assert figures.max() > 200
    assert not figures[0].any()
    assert not figures[-1].any()


def test_kept_texts_are_bounded():
    texts = TextMasks(10)
    for number in range(3000):
        texts(str(number))
    assert len(texts._masks) <= 1024


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        pytest.param("person", "person", id="ascii"),
        pytest.param("Straßenbahn", "Strassenbahn", id="sharp s"),
        pytest.param("Fußgänger", "Fussganger", id="umlaut"),
        pytest.param("自転車", "???", id="no Latin letters"),
        pytest.param("", "", id="empty"),
    ],
)
def test_plain_ascii(text, expected):
    assert plain_ascii(text) == expected
