// Pictures of result pages, each from one heading to another, and of terminal output:
//   node make_docs_pictures.cjs CHROMIUM FOLDER PICTURES
'use strict';
const fs = require('node:fs');
const path = require('node:path');
const { chromium } = require('playwright-core');

const [program, folder, pictures] = process.argv.slice(2);

// Width of a page and of a terminal (px); pictures have twice as many pixels.
const PAGE_WIDTH = 940;
const TERMINAL_WIDTH = 900;
const DENSITY = 2;
// Greatest height of a picture (px).
const TALLEST = 1400;

// Pictures with tables that need more room, and their width (px).
const WIDE = new Set(['fit-actuator-judgement', 'train', 'tune-ekf']);
const WIDE_WIDTH = 1200;

// Name of the picture: page, heading with which it begins (none: the top), heading before which it ends.
const PAGES = {
  'calibrate': ['twin.html', null, 'Residuals'],
  'collect': ['plan/index.html', null, 'Commanded velocities'],
  'demo': ['demo/index.html', null, 'Fit the actuator'],
  'eval': ['demo/eval/index.html', null, 'Replay'],
  'fit-actuator': ['demo/actuator/index.html', 'Measured and predicted', 'Error against horizon'],
  'fit-actuator-judgement': ['demo/actuator/index.html', null, 'Measured and predicted'],
  'gap': ['demo/gap/index.html', null, '2. '],
  'gap-signals': ['demo/gap/index.html', 'Residuals', 'Localization'],
  'play': ['scored/index.html', 'Replay', 'Positions'],
  'sweep': ['sweep/index.html', null, 'Selection'],
  'train': ['demo/learned/index.html', null, 'Learning curves'],
  'tune-ekf': ['demo/ekf/index.html', 'Process noise by region', 'Covariance'],
};

async function shoot(browser, name, [file, from, to]) {
  const page = await browser.newPage({ viewport: { width: WIDE.has(name) ? WIDE_WIDTH : PAGE_WIDTH, height: 1000 }, deviceScaleFactor: DENSITY });
  await page.goto('file://' + path.resolve(folder, file));
  await page.addStyleTag({ content: '.hint{display:none}' });
  await page.waitForTimeout(500);
  if (name === 'play') {
    // A goal of the match instead of its first frame.
    await page.locator('#replay-events button[data-kind=goal]').first().click().catch(() => {});
  }
  const [top, bottom] = await page.evaluate(([from, to, tallest]) => {
    const headings = [...document.querySelectorAll('h2, h3')];
    const y = (text) => {
      const found = headings.find((heading) => heading.textContent.startsWith(text));
      return found ? found.getBoundingClientRect().top + window.scrollY : document.documentElement.scrollHeight;
    };
    const top = from === null ? 0 : y(from) - 12;
    const bottom = y(to) - 16;
    if (bottom - top <= tallest) {
      return [top, bottom];
    }
    // A tall picture ends between two blocks, so that none is cut.
    const blocks = [...document.querySelectorAll('main > *, main > section > *')]
      .filter((block) => !/^H[23]$/.test(block.tagName) && !/^H[23]$/.test(block.lastElementChild?.tagName ?? ''));
    const ends = blocks.map((block) => block.getBoundingClientRect().bottom + window.scrollY + 8);
    const fitting = ends.filter((end) => top + 200 < end && end <= top + tallest);
    return [top, fitting.length ? Math.max(...fitting) : top + tallest];
  }, [from, to, TALLEST]);
  const height = bottom - top;
  await page.screenshot({ path: path.join(pictures, name + '.png'), clip: { x: 0, y: top, width: page.viewportSize().width, height }, fullPage: true });
  await page.close();
}

async function shootTerminal(browser, name) {
  const text = fs.readFileSync(path.join(folder, 'shown', name + '.txt'), 'utf8').trimEnd();
  const page = await browser.newPage({ viewport: { width: TERMINAL_WIDTH, height: 100 }, deviceScaleFactor: DENSITY });
  await page.setContent('<pre id="shown"></pre>');
  await page.addStyleTag({
    content: 'body{margin:0;background:#1d2733}' +
      'pre{margin:0;padding:14px 16px;color:#e6e9ee;font:13px/1.45 "DejaVu Sans Mono",monospace;white-space:pre-wrap;overflow-wrap:anywhere}' +
      'b{color:#8fc1ff;font-weight:600}',
  });
  await page.evaluate((text) => {
    const shown = document.getElementById('shown');
    for (const line of text.split('\n')) {
      const element = document.createElement(line.startsWith('$ ') ? 'b' : 'span');
      element.textContent = line + '\n';
      shown.append(element);
    }
  }, text);
  await page.locator('#shown').screenshot({ path: path.join(pictures, name + '.png') });
  await page.close();
}

async function main() {
  const browser = await chromium.launch({ executablePath: program, args: ['--no-sandbox', '--disable-gpu'] });
  for (const [name, what] of Object.entries(PAGES)) {
    await shoot(browser, name, what);
  }
  for (const file of fs.readdirSync(path.join(folder, 'shown'))) {
    await shootTerminal(browser, path.basename(file, '.txt'));
  }
  await browser.close();
}

main().catch((error) => { console.error(error); process.exit(1); });
