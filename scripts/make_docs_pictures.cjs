// Pictures of result pages, each from one heading to another, and of what terminals showed:
//   node make_docs_pictures.cjs CHROMIUM FOLDER PICTURES
'use strict';
const fs = require('node:fs');
const path = require('node:path');
const { chromium } = require('playwright-core');

const [program, folder, pictures] = process.argv.slice(2);

// Pages are laid out for this width (px) and drawn smaller.
const PAGE_WIDTH = 1080;
const PICTURE_WIDTH = 900;
const TERMINAL_WIDTH = 900;

// Name of the picture: page, heading with which it begins (none: the top), heading before which it ends.
const PAGES = {
  'collect': ['plan/index.html', null, 2],
  'fit-actuator': ['demo/actuator/index.html', 'Measured and predicted', 'Error against horizon'],
  'fit-actuator-judgement': ['demo/actuator/index.html', null, 'Measured and predicted'],
  'tune-ekf': ['demo/ekf/index.html', null, 'Covariance'],
  'gap': ['demo/gap/index.html', null, '2. '],
  'gap-signals': ['demo/gap/index.html', 'The gap, signal by signal', 'Where it sits'],
  'eval': ['demo/eval/index.html', null, 'Where'],
  'train': ['demo/learned/index.html', null, 3],
  'demo': ['demo/index.html', null, 'Fit the actuator'],
  'play': ['scored/index.html', 'Replay', 'Where'],
};

async function shoot(browser, name, [file, from, to]) {
  const scale = PICTURE_WIDTH / PAGE_WIDTH;
  const page = await browser.newPage({ viewport: { width: PAGE_WIDTH, height: 1000 }, deviceScaleFactor: scale });
  await page.goto('file://' + path.resolve(folder, file));
  const play = page.locator('#replay-play');
  if (await play.count()) {
    // A moment of the match instead of its first picture.
    await page.locator('#replay-next').click().catch(() => {});
  }
  const [top, bottom, height] = await page.evaluate(([from, to]) => {
    const headings = [...document.querySelectorAll('h2, h3')];
    const place = (text) => headings.find((heading) => heading.textContent.startsWith(text));
    const y = (element) => element.getBoundingClientRect().top + window.scrollY;
    const height = document.documentElement.scrollHeight;
    const top = from === null ? 0 : y(place(from)) - 12;
    // A number counts rows of pictures below the first one.
    const svgs = [...document.querySelectorAll('svg')];
    const rows = [...new Set(svgs.map((svg) => Math.round(y(svg))))].sort((a, b) => a - b);
    const end = typeof to === 'number' ? rows[Math.min(to, rows.length - 1)] : y(place(to));
    return [top, end - 16, height];
  }, [from, to]);
  const clip = { x: 0, y: top, width: PAGE_WIDTH, height: Math.min(bottom, height) - top };
  await page.screenshot({ path: path.join(pictures, name + '.png'), clip, fullPage: true });
  await page.close();
}

async function shootTerminal(browser, name) {
  const text = fs.readFileSync(path.join(folder, 'shown', name + '.txt'), 'utf8').trimEnd();
  const page = await browser.newPage({ viewport: { width: TERMINAL_WIDTH, height: 100 } });
  await page.setContent('<pre id="shown"></pre>');
  await page.addStyleTag({
    content: 'body{margin:0;background:#1d2733}' +
      'pre{margin:0;padding:14px 16px;color:#e6e9ee;font:13px/1.45 "DejaVu Sans Mono",monospace;white-space:pre-wrap}' +
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
