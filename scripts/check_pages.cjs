// Checks the pages in a folder: console, layout, charts, dark mode and the replay.
//   node check_pages.cjs CHROMIUM FOLDER [PICTURES]
'use strict';
const assert = require('node:assert');
const fs = require('node:fs');
const path = require('node:path');
const { chromium } = require('playwright-core');

const [program, folder, pictures] = process.argv.slice(2);
// A telephone, a laptop and a wide screen (px).
const WIDTHS = [390, 900, 1600];
// Most bytes of a page.
const LARGEST_PAGE = 2.5e6;
// Smallest text of a page (px).
const SMALLEST_TEXT = 12;

// Pages of FOLDER, without those of single points of a sweep and of all but one policy.
function pages() {
  const found = fs.readdirSync(folder, { recursive: true }).map(String).filter((name) => name.endsWith('.html'));
  return found.filter((name) => !/points|seed-\d|demo\/(ideal|randomized|twin)\//.test(name)).sort();
}

async function open(browser, file, width, scheme) {
  const page = await browser.newPage({ viewport: { width, height: 900 }, colorScheme: scheme });
  const complaints = [];
  page.on('console', (message) => { if (['error', 'warning'].includes(message.type())) { complaints.push(message.text()); } });
  page.on('pageerror', (error) => complaints.push(String(error)));
  page.on('request', (request) => { if (!request.url().startsWith('file:')) { complaints.push('asks for ' + request.url()); } });
  await page.goto('file://' + path.resolve(folder, file));
  await page.waitForTimeout(100);
  return [page, complaints];
}

// Elements that reach beyond the window, apart from tables, which scroll.
function cutOff() {
  const wide = document.documentElement.clientWidth;
  const found = [];
  if (wide < document.documentElement.scrollWidth) { found.push('the page is ' + document.documentElement.scrollWidth + ' px wide'); }
  for (const element of document.querySelectorAll('main *')) {
    const box = element.getBoundingClientRect();
    if (box.width && !element.closest('.scroll, .u-wrap, svg') && wide + 1 < box.right) { found.push(element.tagName + '.' + element.className + ' ends at ' + Math.round(box.right)); }
  }
  return found.slice(0, 5);
}

function smallText(smallest) {
  const found = [];
  const walker = document.createTreeWalker(document.querySelector('main'), NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const parent = walker.currentNode.parentElement;
    if (!walker.currentNode.data.trim() || parent.closest('script, style, svg')) { continue; }
    if (parseFloat(getComputedStyle(parent).fontSize) < smallest) { found.push(walker.currentNode.data.trim().slice(0, 40)); }
  }
  return found.slice(0, 5);
}

// Number of visible charts; every one of them must have been drawn.
async function drawn(page, what) {
  const all = () => [...document.querySelectorAll('figure.chart')].every((figure) => !figure.offsetParent || figure.dataset.view);
  await page.waitForFunction(all, null, { timeout: 20000 }).catch(() => {});
  const states = await page.locator('figure.chart:visible').evaluateAll((figures) => figures.map((figure) => {
    const canvas = figure.querySelector('canvas');
    if (!canvas || !figure.dataset.view) { return (figure.querySelector('figcaption') || figure).textContent.slice(0, 60); }
    const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
    for (let k = 3; k < data.length; k += 4) { if (data[k]) { return ''; } }
    return 'blank: ' + (figure.querySelector('figcaption') || figure).textContent.slice(0, 60);
  }));
  assert.deepStrictEqual(states.filter(Boolean), [], what + ': charts that were not drawn');
  return states.length;
}

// Hovers, zooms by drag, resets, and hides a curve by its name in the legend.
async function tryChart(page, figure, what) {
  await figure.scrollIntoViewIfNeeded();
  const over = figure.locator('.u-over');
  const box = await over.boundingBox();
  assert.ok(box && 40 < box.width && 40 < box.height, what + ': no room for the data');
  await page.mouse.move(box.x + 0.4 * box.width, box.y + 0.5 * box.height);
  await page.mouse.move(box.x + 0.45 * box.width, box.y + 0.55 * box.height);
  const readout = await figure.locator('.readout').textContent();
  assert.ok(/\S/.test(readout), what + ': no values under the cursor');
  const before = await figure.getAttribute('data-view');
  await page.mouse.move(box.x + 0.3 * box.width, box.y + 0.3 * box.height);
  await page.mouse.down();
  await page.mouse.move(box.x + 0.5 * box.width, box.y + 0.5 * box.height, { steps: 4 });
  await page.mouse.up();
  assert.notStrictEqual(await figure.getAttribute('data-view'), before, what + ': a drag does not zoom');
  await page.mouse.dblclick(box.x + 0.5 * box.width, box.y + 0.5 * box.height);
  assert.strictEqual(await figure.getAttribute('data-view'), before, what + ': a double-click does not reset the zoom');
  const name = figure.locator('.legend button').first();
  if (await name.count()) {
    const shown = Number(await figure.getAttribute('data-shown'));
    await name.click();
    assert.strictEqual(Number(await figure.getAttribute('data-shown')), shown - 1, what + ': the legend does not hide a curve');
    await name.click();
  }
}

// Charts of one group move their cursors and zoom together.
async function tryGroups(page, what) {
  const groups = await page.locator('figure.chart:visible').evaluateAll((figures) => figures.map((figure) => JSON.parse(figure.querySelector('script').textContent).group || ''));
  const first = groups.findIndex((group, k) => group && groups.indexOf(group, k + 1) !== -1);
  if (first < 0) { return false; }
  const second = groups.indexOf(groups[first], first + 1);
  const [one, other] = [first, second].map((k) => page.locator('figure.chart:visible').nth(k));
  await one.scrollIntoViewIfNeeded();
  const box = await one.locator('.u-over').boundingBox();
  await page.mouse.move(box.x + 0.4 * box.width, box.y + 0.5 * box.height);
  await page.mouse.move(box.x + 0.5 * box.width, box.y + 0.5 * box.height);
  assert.ok(/\S/.test(await other.locator('.readout').textContent()), what + ': the cursor of a group is not shared');
  return true;
}

async function checkPage(browser, file) {
  const bytes = fs.statSync(path.join(folder, file)).size;
  assert.ok(bytes <= LARGEST_PAGE, file + ' has ' + bytes + ' bytes');
  let charts = 0;
  for (const width of WIDTHS) {
    const [page, complaints] = await open(browser, file, width, 'light');
    await page.evaluate(() => { for (const details of document.querySelectorAll('details')) { details.open = true; } });
    const what = file + ' at ' + width + ' px';
    charts = await drawn(page, what);
    assert.deepStrictEqual(await page.evaluate(cutOff), [], what + ': cut off');
    assert.deepStrictEqual(await page.evaluate(smallText, SMALLEST_TEXT), [], what + ': small text');
    if (pictures) { await page.screenshot({ path: path.join(pictures, file.replace(/\//g, '-').replace('.html', '') + '-' + width + '.png'), fullPage: true }); }
    if (width !== 390) {
      for (let k = 0; k < charts; k++) { await tryChart(page, page.locator('figure.chart:visible').nth(k), what + ', chart ' + (k + 1)); }
      await tryGroups(page, what);
    }
    assert.deepStrictEqual(complaints, [], what);
    await page.close();
  }
  const [page, complaints] = await open(browser, file, 1600, 'dark');
  const shade = await page.evaluate(() => getComputedStyle(document.querySelector('main')).backgroundColor.match(/\d+/g).map(Number));
  assert.ok(shade.every((part) => part < 60), file + ': dark mode has a bright page');
  await drawn(page, file + ' in dark mode');
  if (pictures) { await page.screenshot({ path: path.join(pictures, file.replace(/\//g, '-').replace('.html', '') + '-dark.png'), fullPage: true }); }
  assert.deepStrictEqual(complaints, [], file + ' in dark mode');
  await page.close();
  console.log(file + ': ' + charts + ' charts, ' + bytes + ' bytes');
  return charts;
}

// Plays, pauses, scrubs and jumps in the replay of `file`.
async function checkReplay(browser, file) {
  const score = JSON.parse(fs.readFileSync(path.join(folder, path.dirname(file), 'score.json'), 'utf8'));
  const [page, complaints] = await open(browser, file, 1100, 'light');
  const replay = page.locator('#replay');
  const time = async () => Number(await replay.getAttribute('data-time'));
  const board = () => page.locator('#replay-board').evaluate((canvas) => canvas.toDataURL());
  const scrub = (value) => page.locator('#replay-scrub').evaluate((slider, value) => { slider.value = value; slider.dispatchEvent(new Event('input')); }, value);
  assert.strictEqual(await time(), 0);

  // It plays, and the board moves.
  const first = await board();
  await page.click('#replay-play');
  await page.waitForFunction(() => 0.3 < Number(document.getElementById('replay').dataset.time));
  assert.strictEqual(await replay.getAttribute('data-playing'), 'true');
  assert.notStrictEqual(await board(), first);

  // It pauses, and time stands still.
  await page.click('#replay-play');
  const paused = await time();
  await page.waitForTimeout(300);
  assert.strictEqual(await time(), paused);
  assert.strictEqual(await replay.getAttribute('data-playing'), 'false');

  // It scrubs.
  await scrub('20');
  assert.ok(Math.abs(await time() - 20) < 0.01, 'scrubbed to ' + await time());

  // It jumps to an event of the list, to its neighbours, and to a click on the timeline.
  const goals = score.matches[0].episodes.filter((episode) => episode.outcome === 'goal');
  assert.ok(0 < goals.length);
  await page.locator('#replay-events button[data-kind=goal]').first().click();
  assert.ok(Math.abs(await time() - goals[0].end_s) < 0.01, 'jumped to ' + await time() + ', the goal is at ' + goals[0].end_s);
  const goal = await time();
  await page.click('#replay-next');
  assert.ok(goal < await time());
  await page.click('#replay-back');
  assert.ok(Math.abs(await time() - goal) < 0.001);
  const line = await page.locator('#replay-timeline').boundingBox();
  await page.mouse.click(line.x + line.width / 2, line.y + line.height / 2);
  assert.ok(Math.abs(await time() - score.matches[0].duration_s / 2) < 0.2);

  // It lists only the chosen kind of event.
  await page.selectOption('#replay-kind', 'strike');
  const strikes = score.matches[0].episodes.reduce((sum, episode) => sum + episode.strikes_left + episode.strikes_right, 0);
  assert.strictEqual(await page.locator('#replay-events button').count(), strikes);

  // At the end it shows the final score and stops; playing begins anew.
  await scrub(String(score.matches[0].duration_s + 1));
  const points = (side) => score.matches[0].episodes.filter((episode) => episode.scorer === side).length;
  assert.strictEqual(await replay.getAttribute('data-score'), points('left') + ':' + points('right'));
  await page.click('#replay-play');
  await page.waitForFunction(() => Number(document.getElementById('replay').dataset.time) < 5);
  await page.click('#replay-play');
  assert.deepStrictEqual(complaints, [], file);
  await page.close();
  console.log('the replay plays, pauses, scrubs and jumps; ' + goals.length + ' goals, ' + strikes + ' strikes');
}

async function main() {
  const browser = await chromium.launch({ executablePath: program, args: ['--no-sandbox', '--disable-gpu'] });
  const files = pages();
  let charts = 0;
  for (const file of files) { charts += await checkPage(browser, file); }
  await checkReplay(browser, 'match/index.html');
  await browser.close();
  assert.ok(9 <= files.length, 'only ' + files.join(', '));
  console.log(files.length + ' pages and ' + charts + ' charts pass at ' + WIDTHS.join(', ') + ' px and in dark mode');
}

main().catch((error) => { console.error(error); process.exit(1); });
