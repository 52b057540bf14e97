"""How wordings are compared: case, accents, plurals, British and American spelling, and small misspellings aside."""

from __future__ import annotations

import re
import unicodedata

#: Characters that Unicode does not take apart the way people write them out.
WRITTEN_OUT = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "œ": "oe", "æ": "ae", "ø": "oe"})
#: Chinese characters: there are no spaces between words, so each is a word of its own here.
HAN = "㐀-鿿"
_WORD = re.compile(rf"[a-z0-9]+|[{HAN}]|[^\W_a-z0-9{HAN}]+")
_ACCENTED = re.compile("[À-ɏḀ-ỿ]+")
#: Before a French noun: l'abdomen, d'aspiration.
_ELIDED = re.compile(r"\b[ldnst]'(?=[^\W\d_]{3})")


def words(text: str) -> list[str]:
    """Lower-case words in the singular, without accents, punctuation and underscores: `"L-Hooks!"` → `["l", "hook"]`.

    A Chinese character is a word; words of other scripts stay as they are.
    """
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", unicodedata.normalize("NFKC", text))
    plain = text.casefold().translate(WRITTEN_OUT).replace("’", "'")
    plain = _ACCENTED.sub(lambda found: _without_accents(found.group()), plain)
    plain = _ELIDED.sub("", plain).replace("'s ", " ").replace("'", "")
    return [singular(word) for word in _WORD.findall(plain)]


def _without_accents(text: str) -> str:
    return "".join(letter for letter in unicodedata.normalize("NFKD", text) if not unicodedata.combining(letter))


def singular(word: str) -> str:
    """The singular, or the same odd form for a name and its plural: both sides of a comparison go through here."""
    if len(word) > 4 and word.endswith("ies"):
        return word[:-3] + "y"
    if len(word) > 4 and word.endswith(("sses", "shes", "ches", "xes")):
        return word[:-2]
    if len(word) > 3 and word.endswith("s") and not word.endswith(("ss", "us", "is")):
        return word[:-1]
    return word


def american(word: str) -> str:
    """One spelling for both sides of the Atlantic: haemorrhage, tumour, cauterised → hemorrhage, tumor, cauterized."""
    word = re.sub("(?<=[a-z])(ae|oe)(?=[a-z])|^(ae|oe)(?=[a-z])", "e", word)
    word = re.sub("our(?=s?$|ed$|ing$|less$)", "or", word)
    return re.sub("(?<=[a-z]{3})is(?=e$|ed$|er$|ing$|ation$)", "iz", word)


def key(text: str) -> str:
    """What is compared: the words joined, in one spelling, so that "gall bladder", "gall-bladder" and "Gallbladders" are one."""
    return "".join(american(word) for word in words(text))


def edit_distance(a: str, b: str) -> int:
    """Insertions, deletions, substitutions and swaps of neighbours between two words (optimal string alignment)."""
    before: list[int] = []
    row = list(range(len(b) + 1))
    for i, x in enumerate(a, 1):
        oldest, before, row = before, row, [i]
        for j, y in enumerate(b, 1):
            cost = min(before[j] + 1, row[j - 1] + 1, before[j - 1] + (x != y))
            if i > 1 and j > 1 and x == b[j - 2] and a[i - 2] == y:
                cost = min(cost, oldest[j - 2] + 1)
            row.append(cost)
    return row[-1]


def allowed_errors(name: str) -> int:
    """Errors that are tolerated in a name: none in short words, which differ by one letter from too many others; endings do not count."""
    letters = len(_ENDING.sub("", name))
    return 0 if len(name) < 5 else 1 if letters < 8 else 2 if letters < 13 else 3


def allowed_errors_foreign(name: str) -> int:
    """The same for a name of another language: half as many, because words of all languages are compared at once; none in Chinese."""
    return allowed_errors(name) // 2 if name.isascii() else 0


def spelling_errors(typed: str, name: str, allowed: int) -> int | None:
    """Edit distance of `typed` from `name`; None for more than `allowed`, and for other consonants in a short name."""
    if not allowed or typed[0] != name[0] or abs(len(typed) - len(name)) > allowed:
        return None
    distance = edit_distance(typed, name)
    if distance > allowed or (allowed == 1 and sorted(_consonants(typed)) != sorted(_consonants(name))):
        return None
    return distance


_ENDING = re.compile("(?:ing|ed|er|or|ment|ation|ion|ive|is|us|ic|age)$")


def _consonants(word: str) -> str:
    """Without vowels, doubled ones once."""
    return re.sub(r"(.)\1+", r"\1", re.sub("[aeiouy]", "", word))
