"""A page of a study, opened in Chromium from its file."""


class Opened:
    """A page in the browser, and what it asked for and complained of.

    With `all_charts` charts are painted where they are not seen too.
    """

    def __init__(self, browser, path, width=1280, scheme="light", all_charts=True):
        self.requests, self.complaints = [], []
        self.page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("console", lambda message: self.complaints.append(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.goto(path.as_uri())
        self.page.wait_for_selector("html[data-ready]")
        if all_charts:
            self.paint_all()

    def __enter__(self):
        return self

    def click_in_table(self, selector):
        """Click in the table, which draws its rows anew whenever it scrolls into view: a click meanwhile is lost."""
        self.page.evaluate(
            """async () => {
              document.getElementById("table").scrollIntoView({ block: "center" });
              for (let k = 0; k < 3; k++) await new Promise(requestAnimationFrame);
              await new Promise((done) => requestIdleCallback(done));
            }"""
        )
        self.page.click(f"#table {selector}")

    def paint_all(self):
        """Paint the charts that are not seen too, at once and from now on."""
        self.page.evaluate("{ near = Infinity; [...unpainted.keys()].forEach(paint); }")

    def __exit__(self, *_):
        self.page.close()

    def colours(self, chart):
        """Return how many pixels of a chart are drawn, and in how many colours."""
        return self.page.evaluate(
            """(id) => {
              const { width, height } = document.querySelector(`#${id} canvas`);
              const copy = Object.assign(document.createElement("canvas"), { width, height });
              const paper = copy.getContext("2d", { willReadFrequently: true });
              paper.drawImage(document.querySelector(`#${id} canvas`), 0, 0);
              const data = paper.getImageData(0, 0, width, height).data;
              const seen = new Set();
              let drawn = 0;
              for (let k = 0; k < data.length; k += 4) {
                if (data[k + 3] === 0) continue;
                drawn += 1;
                seen.add((data[k] << 16) | (data[k + 1] << 8) | data[k + 2]);
              }
              return [drawn, seen.size];
            }""",
            chart,
        )

    def cells(self, title):
        """Return what the table shows in one column."""
        place = self.page.evaluate("(name) => columns.findIndex((one) => one.name === name)", title)
        return self.page.locator(f'#table .tabulator-cell[tabulator-field="c{place}"]').all_inner_texts()

    def filter(self, title, text):
        place = self.page.evaluate("(name) => columns.findIndex((one) => one.name === name)", title)
        box = self.page.locator(f'#table .tabulator-col[tabulator-field="c{place}"] input')
        box.fill("")
        before = self.page.inner_text("#count")
        box.press_sequentially(text)
        # Tabulator waits for the end of typing
        self.page.wait_for_function('(before) => document.getElementById("count").textContent !== before', arg=before)
        self.page.wait_for_timeout(400)
