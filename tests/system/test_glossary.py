"""The glossary has each term once, in alphabetical order."""

import re

import pages

GLOSSARY = pages.texts()["framework/GLOSSARY.md"]
TERMS = re.findall(r"^### (.*)$", GLOSSARY, re.MULTILINE)


def test_each_term_occurs_once() -> None:
    assert len(TERMS) > 30
    spelled = [re.sub(r"\W", "", term.casefold()) for term in TERMS]
    assert len(set(spelled)) == len(spelled)
    assert all(GLOSSARY.count(f"\n### {term}\n\n") == 1 for term in TERMS)


def test_the_terms_are_in_alphabetical_order() -> None:
    greek = str.maketrans({"θ": "theta"})
    assert sorted(TERMS, key=lambda term: term.casefold().translate(greek)) == TERMS


def test_the_pages_use_the_glossary_and_define_no_other() -> None:
    others = {name: page for name, page in pages.texts().items() if name != "framework/GLOSSARY.md"}
    assert not [name for name, page in others.items() if re.search(r"^#+ Glossary", page, re.MULTILINE)]
    assert any("GLOSSARY.md" in page for page in others.values())
