"""What is wrong with XML that is not well-formed, in words for people who write SSML and do not know expat."""

from __future__ import annotations

from xml.parsers import expat


def complaint(error: expat.ExpatError, inner: str) -> tuple[str, str]:
    """What is wrong, and what to do about it (or nothing).

    Args:
        error: expat's.
        inner: name of the innermost element that has not ended; empty if there is none.
    """
    told = expat.errors.messages.get(error.code, str(error))
    match told:
        case expat.errors.XML_ERROR_NO_ELEMENTS | expat.errors.XML_ERROR_SYNTAX if not inner:
            return "no element begins here", "SSML looks like this: <speak>Hello.</speak>"
        case expat.errors.XML_ERROR_NO_ELEMENTS:
            return f"the document ends, but {inner} has not ended", f"Write </{inner}>."
        case expat.errors.XML_ERROR_TAG_MISMATCH:
            return f"another element than {inner} ends", f"Write </{inner}> before."
        case expat.errors.XML_ERROR_UNDEFINED_ENTITY:
            return "the entity is not known", "There are &amp; &lt; &gt; &quot; &apos; and numbers like &#233;."
        case expat.errors.XML_ERROR_JUNK_AFTER_DOC_ELEMENT:
            return "something follows the end of speak", "Put all into one <speak>."
        case expat.errors.XML_ERROR_INVALID_TOKEN:
            return "this is not well-formed XML", "Write & as &amp; and < as &lt;."
    return told, ""
