"""A page of a study, opened in Chromium from its file, and the numbers of charts that are drawn as SVG."""

from xml.etree import ElementTree as ET


class Opened:
    """A page in the browser with all its charts drawn, and what it asked for and complained of."""

    def __init__(self, browser, path, width=1280, scheme="light", all_charts=True):
        self.requests, self.complaints = [], []
        self.page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("console", lambda message: self.complaints.append(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.goto(path.as_uri())
        self.page.wait_for_selector("html[data-ready]")
        if all_charts:
            self.draw_all()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.page.close()

    def draw_all(self):
        """Draw the charts that are not seen too."""
        self.page.evaluate("async () => { [...stale].forEach(paint); await drawn; }")

    def svg(self, chart):
        self.draw_all()
        return self.page.evaluate("(id) => views[id].view.toSVG()", chart)

    def cells(self, title):
        """Return what the table shows in one column."""
        return self.page.locator(f'#table .tabulator-cell[tabulator-field="{self.field(title)}"]').all_inner_texts()

    def field(self, title):
        return self.page.evaluate("(name) => page.columns.find((one) => one.name === name).field", title)

    def filter(self, title, text):
        self.page.evaluate("([field, text]) => table.setHeaderFilterValue(field, text)", [self.field(title), text])


def drawn(svg, layer):
    """Return what each mark of a layer says of itself, its text and its weight, as dictionaries of texts."""
    groups = [one for one in ET.fromstring(svg).findall(".//{*}g") if f" {layer}_marks" in one.get("class", "")]
    out = []
    for mark in (mark for group in groups for mark in group):
        told = dict(part.split(": ", 1) for part in mark.get("aria-label", "").split("; ") if ": " in part)
        out.append(told | {"text": "".join(mark.itertext()), "weight": mark.get("font-weight", "")})
    return out
