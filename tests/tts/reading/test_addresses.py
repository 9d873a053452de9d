import pytest

from app.tts.reading.addresses import address, camel


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("https://www.example.org/", "example dot org"),
        ("http://example.com/a-b_c", "example dot com slash a dash b underscore c"),
        ("ftp://example.com?x=1&y#z", "example dot com question mark x equals one and y hash z"),
        ("www.bbc.co.uk", "B.B.C dot co dot U.K"),
        ("example.com", "example dot com"),
        ("example.com:8080/status", "example dot com colon eight thousand eighty slash status"),
        ("jane.doe+news@example.org", "jane dot doe plus news at example dot org"),
        ("mailto:a@b.de", "a at b dot D.E"),
        ("@jane_doe", "at jane underscore doe"),
        ("#HelloWorld2026", "hashtag Hello World two thousand twenty six"),
        ("report.pdf", "report dot P.D.F"),
        ("/usr/local/bin", "slash usr slash local slash bin"),
        ("C:\\temp\\", "C colon backslash temp"),
        ("http://", "H.T.T.P"),
        ("file:///", "file"),
        ("hello", ""),
        ("3.14", ""),
        ("end.Next", ""),
        ("a@b", ""),
        ("..", ""),
        ("", ""),
    ],
)  # fmt: skip
def test_addresses(written: str, said: str) -> None:
    assert address(written) == said


def test_camel() -> None:
    assert camel("iLoveNYC_now") == "i Love N.Y.C now"
