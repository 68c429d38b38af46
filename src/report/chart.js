// Charts of a page. uPlot draws axes, cursor and selection; this script draws the data, which stand as JSON in each
// figure (written by chart.rs), and handles legend, values under the cursor, zoom and groups with a shared cursor.
(function () {
  'use strict';
  const LEFT = 52, BOTTOM = 34, LABEL = 22, PADDING = [10, 16, 0, 0], TALLEST = 640;
  const NEAR = 28, NARROW_CATEGORY = 110, FONT = '13px system-ui, sans-serif', LABEL_FONT = '14px system-ui, sans-serif';
  const root = document.documentElement;
  const groups = new Map();
  let colours = {};
  const colour = (name) => colours[name] || (colours[name] = getComputedStyle(root).getPropertyValue('--' + name).trim());

  const text = (value, digits) => {
    if (value === null || !isFinite(value)) { return '–'; }
    const size = Math.abs(value);
    if (size !== 0 && (size < 1e-4 || 1e6 <= size)) { return value.toExponential(digits - 1); }
    return String(Number(value.toPrecision(digits)));
  };
  const unpack = (values) => Array.isArray(values) ? values : Array.from({ length: values.n }, (_, k) => values.s + k * values.d);
  const element = (tag, name, parent) => {
    const made = document.createElement(tag);
    if (name) { made.className = name; }
    if (parent) { parent.append(made); }
    return made;
  };

  // ---- Extents -------------------------------------------------------------------------------------------------

  class Extent {
    constructor(log) { this.low = Infinity; this.high = -Infinity; this.log = log; }
    add(value) {
      if (value === null || value === undefined || !isFinite(value) || (this.log && value <= 0)) { return; }
      if (value < this.low) { this.low = value; }
      if (this.high < value) { this.high = value; }
    }
    padded(share) {
      let { low, high } = this;
      if (high < low) { return this.log ? [0.1, 10] : [0, 1]; }
      if (this.log) {
        const factor = Math.max(1.2, Math.pow(high / low, share));
        return [low / factor, high * factor];
      }
      if (low === high) { const half = Math.abs(low) * 0.05 || 0.5; return [low - half, high + half]; }
      return [low - share * (high - low), high + share * (high - low)];
    }
  }

  // Marks of a logarithmic axis: 1, 2, 5 in each decade, or decades alone where there are many.
  function decades(low, high) {
    const steps = 3 < Math.log10(high / low) ? [1] : [1, 2, 5];
    const marks = [];
    for (let k = Math.floor(Math.log10(low)) - 1; k <= Math.ceil(Math.log10(high)); k++) {
      for (const step of steps) {
        const mark = Number((step + 'e' + k));
        if (low * 0.9999 <= mark && mark <= high * 1.0001) { marks.push(mark); }
      }
    }
    if (2 <= marks.length) { return marks; }
    // Less than a decade: even steps of 1, 2 or 5.
    const rough = (high - low) / 4, power = Math.pow(10, Math.floor(Math.log10(rough)));
    const step = [1, 2, 5, 10].map((k) => k * power).find((one) => rough <= one);
    const even = [];
    for (let mark = Math.ceil(low / step) * step; mark <= high; mark += step) { even.push(Number(mark.toPrecision(6))); }
    return even;
  }

  // ---- One chart -----------------------------------------------------------------------------------------------

  class Chart {
    constructor(figure) {
      this.figure = figure;
      this.data = JSON.parse(figure.querySelector('script').textContent);
      this.plane = this.data.kind === 'plane';
      this.box = figure.querySelector('.plot');
      this.readout = figure.querySelector('.readout');
      for (const series of this.data.series) {
        series.show = true;
        for (const curve of series.curves) {
          curve.x = unpack(curve.x);
          for (const key of ['y', 'low', 'high']) { if (curve[key]) { curve[key] = unpack(curve[key]); } }
        }
      }
      this.full = this.fullX();
      this.view = { x: this.full, y: null };
      this.legend();
      this.build();
      if (this.data.group) {
        groups.set(this.data.group, (groups.get(this.data.group) || []).concat([this]));
      }
    }

    // All points of visible series with x within `span`, where one is given.
    extents(span) {
      const { x: ax, y: ay } = this.data;
      const x = new Extent(ax.log), y = new Extent(ay.log);
      for (const series of this.data.series) {
        if (series.level !== undefined) { if (series.show) { y.add(series.level); } continue; }
        if (span && !series.show) { continue; }
        for (const curve of series.curves) {
          curve.x.forEach((at, k) => {
            if (span && (at < span[0] || span[1] < at)) { return; }
            x.add(at);
            for (const values of [curve.y, curve.low, curve.high]) { if (values) { y.add(values[k]); } }
          });
        }
      }
      if (ay.include !== undefined && !this.plane) { y.add(ay.include); }
      return [x, y];
    }

    fullX() {
      const { x, grid } = this.data;
      if (x.range) { return x.range; }
      if (grid) { return grid.x; }
      if (x.categories) { return [-0.5, x.categories.length - 0.5]; }
      return this.extents(null)[0].padded(this.plane ? 0.04 : 0);
    }

    fullY() {
      const { y, grid } = this.data;
      if (y.range) { return y.range; }
      if (grid) { return grid.y; }
      if (y.categories) { return [-0.5, y.categories.length - 0.5]; }
      if (this.plane) { return this.extents(null)[1].padded(0.04); }
      return this.extents(this.view.x)[1].padded(0.06);
    }

    ranges() {
      const x = this.view.x;
      const y = this.view.y || this.fullY();
      return [x, y];
    }

    size() {
      const wide = Math.max(220, Math.floor(this.box.getBoundingClientRect().width));
      const aside = LEFT + LABEL + PADDING[1], below = BOTTOM + LABEL + PADDING[0] + this.extraBelow();
      if (!this.data.equal) { return [wide, this.data.height]; }
      const y = this.fullY(), ratio = (y[1] - y[0]) / (this.full[1] - this.full[0]);
      const tallest = Math.min(TALLEST, this.data.height);
      let width = wide - aside, height = width * ratio;
      if (tallest < height) { height = tallest; width = height / ratio; }
      return [Math.round(width + aside), Math.round(height + below)];
    }

    extraBelow() { return 17 * (this.categoryLines() - 1); }

    categoryLines() {
      const names = this.data.x.categories;
      return !names || this.numbered() ? 1 : Math.max(1, ...names.map((name) => name.split('\n').length));
    }

    // Whether categories are too narrow for their names.
    numbered() {
      const names = this.data.x.categories;
      if (!names) { return false; }
      const longest = Math.max(...names.map((name) => Math.max(...name.split('\n').map((line) => line.length))));
      const each = (this.box.getBoundingClientRect().width - LEFT - LABEL) / names.length;
      return each < Math.min(NARROW_CATEGORY, 8.6 * longest);
    }

    build() {
      const [width, height] = this.size();
      this.list();
      const options = {
        width, height, padding: PADDING, legend: { show: false },
        scales: { x: this.scale('x'), y: this.scale('y') },
        axes: [this.axis('x', 0), this.axis('y', 1)],
        series: [{}, { stroke: 'transparent', points: { show: false } }],
        cursor: {
          x: true, y: this.plane, points: { show: false }, drag: { x: true, y: this.plane, setScale: false, dist: 4, uni: this.plane ? 1 : null },
          bind: { dblclick: () => () => { this.reset(); return null; } },
        },
        hooks: { drawClear: [() => this.drawGrid()], draw: [() => this.draw()], setSelect: [() => this.selected()], setCursor: [() => this.moved()] },
      };
      const [x] = this.ranges();
      this.plot = new uPlot(options, [[x[0], x[1]], [null, null]], this.box);
      this.spots = this.data.series.map(() => element('div', 'spot', this.plot.over));
      this.refresh();
    }

    scale(name) {
      const axis = this.data[name];
      return { time: false, distr: axis.log ? 3 : 1, dir: axis.reversed ? -1 : 1, range: () => this.ranges()[name === 'x' ? 0 : 1].slice() };
    }

    axis(name, side) {
      const axis = this.data[name];
      const made = {
        scale: name, font: FONT, labelFont: LABEL_FONT, label: axis.label, labelSize: LABEL,
        size: side === 0 ? BOTTOM + this.extraBelow() : LEFT, stroke: () => colour('soft'), gap: 5,
        grid: { stroke: () => colour('grid'), width: 1, show: !this.data.grid && !(side === 0 && axis.categories) },
        ticks: { stroke: () => colour('grid'), width: 1, size: 6 },
        space: side === 0 ? 64 : 34,
      };
      if (axis.categories) {
        const names = axis.categories, short = side === 0 && this.numbered();
        made.splits = () => names.map((_, k) => k);
        made.values = () => names.map((one, k) => short ? String(k + 1) : one);
      } else if (axis.log) {
        made.splits = (u, _, low, high) => decades(low, high);
        made.filter = (u, splits) => splits;
        made.values = (u, splits) => splits.map((value) => text(value, 4));
      } else {
        made.values = (u, splits) => splits.map((value) => text(value, 6));
      }
      if (side === 1 && axis.categories) {
        // Long names get as much room as the width allows, and end in an ellipsis beyond it.
        const most = Math.min(260, 0.4 * this.box.getBoundingClientRect().width), letters = Math.floor((most - 16) / 7.4);
        made.size = Math.min(most, 16 + 7.4 * Math.max(...axis.categories.map((one) => one.length)));
        made.values = () => axis.categories.map((one) => one.length <= letters ? one : one.slice(0, letters - 1) + '…');
      }
      return made;
    }

    // Names of numbered categories, below the legend.
    list() {
      let list = this.figure.querySelector('ol');
      if (!this.numbered()) { if (list) { list.remove(); } return; }
      if (list) { return; }
      list = element('ol');
      for (const name of this.data.x.categories) { element('li', '', list).textContent = name.replace(/\n/g, ' '); }
      this.figure.append(list);
    }

    resize() {
      const [width, height] = this.size();
      if (this.data.x.categories && this.wasNumbered !== this.numbered()) {
        this.wasNumbered = this.numbered();
        this.plot.destroy();
        this.build();
      } else if (width !== this.plot.width || height !== this.plot.height) {
        this.plot.setSize({ width, height });
        this.refresh();
      }
    }

    refresh() {
      const [x, y] = this.ranges();
      this.plot.batch(() => {
        this.plot.setScale('x', { min: x[0], max: x[1] });
        this.plot.setScale('y', { min: y[0], max: y[1] });
      });
      this.plot.redraw(false, true);
      this.figure.dataset.view = [...x, ...y].map((value) => value.toPrecision(6)).join(' ');
      this.figure.dataset.shown = this.data.series.filter((series) => series.show).length;
    }

    // ---- Zoom

    selected() {
      const { left, top, width, height } = this.plot.select;
      if (width < 4 && height < 4) { return; }
      const at = (pixel, axis) => this.plot.posToVal(pixel, axis);
      let x = 0 < width ? [at(left, 'x'), at(left + width, 'x')] : this.view.x;
      let y = this.plane ? (0 < height ? [at(top + height, 'y'), at(top, 'y')] : this.ranges()[1]) : null;
      for (const range of [x, y]) { if (range) { range.sort((a, b) => a - b); } }
      if (this.data.equal) { [x, y] = this.square(x, y); }
      this.plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
      this.zoom(x, y);
    }

    // The selection enlarged to the shape of the plot, so that both axes keep one scale.
    square(x, y) {
      const wide = this.plot.over.clientWidth, tall = this.plot.over.clientHeight;
      const unit = Math.max((x[1] - x[0]) / wide, (y[1] - y[0]) / tall);
      const about = (range, pixels) => { const middle = (range[0] + range[1]) / 2; return [middle - unit * pixels / 2, middle + unit * pixels / 2]; };
      return [about(x, wide), about(y, tall)];
    }

    zoom(x, y) {
      for (const chart of this.group()) {
        chart.view = { x, y: chart === this ? y : null };
        chart.refresh();
      }
    }

    reset() {
      for (const chart of this.group()) { chart.view = { x: chart.full, y: null }; chart.refresh(); }
    }

    group() { return groups.get(this.data.group) || [this]; }

    // ---- Legend and values

    legend() {
      const box = this.figure.querySelector('.legend');
      this.values = this.data.series.map((series) => {
        if (!series.name) { return null; }
        const button = element('button', '', box);
        button.type = 'button';
        button.title = 'click: hide or show';
        button.setAttribute('aria-pressed', 'true');
        const key = element('span', 'key ' + this.key(series), button);
        key.style.borderColor = key.style.color = 'var(--' + series.colour + ')';
        if (/dot|area/.test(key.className)) { key.style.background = 'var(--' + series.colour + ')'; }
        button.append(series.name);
        const value = element('span', 'value', button);
        button.addEventListener('click', () => {
          series.show = !series.show;
          button.setAttribute('aria-pressed', String(series.show));
          this.refresh();
        });
        return value;
      });
      const grid = this.data.grid;
      if (grid && grid.classes) {
        for (const [name, shade] of grid.classes) {
          const item = element('span', '', box);
          const key = element('span', 'key area', item);
          key.style.background = 'var(--' + shade + ')';
          item.append(name);
          item.style.marginRight = '8px';
        }
      } else if (grid) {
        const item = element('span', '', box);
        item.append(grid.label + ': ' + (grid.log ? text(Math.pow(10, grid.low), 3) : text(grid.low, 3)));
        element('span', 'bar', item);
        item.append((grid.log ? text(Math.pow(10, grid.high), 3) : text(grid.high, 3)) + (grid.clipped ? ' or more' : ''));
      }
    }

    key(series) {
      if (series.mark === 'dashed') { return 'dashed'; }
      if (series.mark === 'dots' || series.mark === 'crosses') { return 'dot'; }
      return series.mark === 'rings' ? 'ring' : series.mark === 'band' ? 'area' : '';
    }

    named(axis, value) {
      const names = axis.categories;
      if (names) { return (names[Math.round(value)] || '').replace(/\n/g, ' '); }
      return axis.name + ' ' + text(value, 4) + (axis.unit ? ' ' + axis.unit : '');
    }

    moved() {
      if (!this.spots) { return; }
      const { left, top } = this.plot.cursor;
      const inside = 0 <= left && 0 <= top;
      this.show(inside ? left : null, top);
      if (Chart.leading) { return; }
      Chart.leading = true;
      for (const other of this.group()) {
        if (other === this || !other.plot) { continue; }
        const at = inside ? other.plot.valToPos(this.plot.posToVal(left, 'x'), 'x') : -10;
        other.plot.setCursor({ left: at, top: inside ? 1 : -10 });
      }
      Chart.leading = false;
    }

    show(left, top) {
      for (const spot of this.spots) { spot.style.display = 'none'; }
      if (left === null) {
        this.readout.textContent = '';
        for (const value of this.values) { if (value) { value.textContent = ''; } }
        return;
      }
      if (this.plane) { this.showPlane(left, top); } else { this.showLine(left); }
    }

    showLine(left) {
      const x = this.plot.posToVal(left, 'x'), { x: ax, y: ay } = this.data;
      let alone = '';
      let snapped = null;
      this.data.series.forEach((series, index) => {
        const found = series.show ? this.valuesAt(series, x) : null;
        const shown = found ? found.text : '';
        if (found && found.x !== undefined && (snapped === null || Math.abs(found.x - x) < Math.abs(snapped - x))) { snapped = found.x; }
        if (this.values[index]) { this.values[index].textContent = shown; } else if (shown) { alone = shown; }
        if (found && found.y !== undefined && found.y !== null) { this.spot(index, found.x, found.y, series.colour); }
      });
      this.readout.textContent = this.named(ax, ax.categories ? x : snapped === null ? x : snapped) + (alone ? ': ' + alone + (ay.unit ? ' ' + ay.unit : '') : '');
    }

    spot(index, x, y, name) {
      const left = this.plot.valToPos(x, 'x'), top = this.plot.valToPos(y, 'y');
      if (left < 0 || this.plot.over.clientWidth < left || top < 0 || this.plot.over.clientHeight < top) { return; }
      const style = this.spots[index].style;
      style.left = left + 'px'; style.top = top + 'px'; style.background = colour(name); style.display = 'block';
    }

    // What a series says at `x`: the nearest point of each of its curves.
    valuesAt(series, x) {
      if (series.level !== undefined) { return { text: text(series.level, 4) }; }
      const found = [];
      for (const curve of series.curves) {
        if (!curve.y && series.mark !== 'band') { continue; }
        const k = nearest(curve.x, x);
        if (k === null) { continue; }
        const near = !this.data.x.categories || Math.abs(curve.x[k] - x) < 0.5;
        if (near && (curve.y ? curve.y[k] !== null : true)) { found.push([curve, k]); }
      }
      if (!found.length) { return null; }
      const [curve, k] = found[0];
      const range = curve.low && curve.low[k] !== null ? ' (' + text(curve.low[k], 4) + ' to ' + text(curve.high[k], 4) + ')' : '';
      if (1 < found.length) {
        const all = found.map(([one, at]) => one.y[at]);
        return { text: text(Math.min(...all), 4) + ' to ' + text(Math.max(...all), 4), x: curve.x[k] };
      }
      return { text: (curve.y ? text(curve.y[k], 4) : '') + range, x: curve.x[k], y: curve.y ? curve.y[k] : null };
    }

    showPlane(left, top) {
      const x = this.plot.posToVal(left, 'x'), y = this.plot.posToVal(top, 'y');
      const parts = [];
      const near = this.nearestPoint(left, top);
      if (near) {
        parts.push((near.series.name ? near.series.name + ': ' : '') + this.named(this.data.x, near.x) + ', ' + this.named(this.data.y, near.y));
        this.spot(near.index, near.x, near.y, near.series.colour);
      } else {
        parts.push(this.named(this.data.x, x) + ', ' + this.named(this.data.y, y));
      }
      const cell = this.cellAt(x, y);
      if (cell) { parts.push(cell); }
      this.readout.textContent = parts.join('; ');
    }

    nearestPoint(left, top) {
      let best = null, least = NEAR * NEAR;
      this.data.series.forEach((series, index) => {
        if (!series.show || series.quiet) { return; }
        for (const curve of series.curves) {
          for (let k = 0; k < curve.x.length; k++) {
            if (curve.x[k] === null || curve.y[k] === null) { continue; }
            const dx = this.plot.valToPos(curve.x[k], 'x') - left, dy = this.plot.valToPos(curve.y[k], 'y') - top;
            if (dx * dx + dy * dy < least) { least = dx * dx + dy * dy; best = { series, index, x: curve.x[k], y: curve.y[k] }; }
          }
        }
      });
      return best;
    }

    cellAt(x, y) {
      const grid = this.data.grid;
      if (!grid) { return ''; }
      const rows = grid.values.length, columns = rows ? grid.values[0].length : 0;
      const column = Math.floor((x - grid.x[0]) / (grid.x[1] - grid.x[0]) * columns);
      const row = Math.floor((y - grid.y[0]) / (grid.y[1] - grid.y[0]) * rows);
      if (row < 0 || rows <= row || column < 0 || columns <= column) { return ''; }
      const value = grid.values[row][column];
      if (value === null) { return 'no data'; }
      if (grid.classes) { return (grid.classes[value] || [''])[0]; }
      return grid.label + ' ' + text(grid.log ? Math.pow(10, value) : value, 4);
    }

    // ---- Drawing

    clipped(draw) {
      const ink = this.plot.ctx, { left, top, width, height } = this.plot.bbox;
      ink.save();
      ink.beginPath(); ink.rect(left, top, width, height); ink.clip();
      draw(ink, (x) => this.plot.valToPos(x, 'x', true), (y) => this.plot.valToPos(y, 'y', true), uPlot.pxRatio);
      ink.restore();
    }

    drawGrid() {
      const grid = this.data.grid;
      if (!grid) { return; }
      const ends = [colour('shade-0'), colour('shade-1')].map(rgb);
      this.clipped((ink, px, py, ratio) => {
        const rows = grid.values.length;
        grid.values.forEach((values, row) => {
          const edge = (range, k, n) => range[0] + (range[1] - range[0]) * k / n;
          const bottom = Math.round(py(edge(grid.y, row, rows))), above = Math.round(py(edge(grid.y, row + 1, rows)));
          values.forEach((value, column) => {
            if (value === null) { return; }
            const from = Math.round(px(edge(grid.x, column, values.length))), to = Math.round(px(edge(grid.x, column + 1, values.length)));
            const share = grid.classes ? 0 : Math.min(1, Math.max(0, (value - grid.low) / (grid.high - grid.low || 1)));
            ink.fillStyle = grid.classes ? colour((grid.classes[value] || ['', 'grey'])[1]) : mix(ends, share);
            ink.fillRect(from, above, to - from, bottom - above);
            const words = grid.text && grid.text[row][column];
            if (words) { this.write(ink, words, [from, above, to, bottom], share, ratio); }
          });
        });
      });
    }

    write(ink, words, [left, top, right, bottom], share, ratio) {
      ink.font = 13 * ratio + 'px system-ui, sans-serif';
      if (right - left < ink.measureText(words).width + 6 * ratio || bottom - top < 16 * ratio) { return; }
      const dark = matchMedia('(prefers-color-scheme:dark)').matches;
      ink.fillStyle = (share < 0.5) === dark ? '#fff' : '#10161d';
      ink.textAlign = 'center'; ink.textBaseline = 'middle';
      ink.fillText(words, (left + right) / 2, (top + bottom) / 2);
    }

    draw() {
      this.clipped((ink, px, py, ratio) => {
        for (const series of this.data.series) {
          if (!series.show) { continue; }
          ink.strokeStyle = ink.fillStyle = colour(series.colour);
          ink.lineWidth = (series.width || 1.8) * ratio;
          ink.lineJoin = 'round';
          ink.setLineDash(series.mark === 'dashed' ? [7 * ratio, 4 * ratio] : []);
          if (series.level !== undefined) { level(ink, py(series.level), this.plot.bbox); continue; }
          for (const curve of series.curves) {
            if (curve.low) { (series.whiskers ? whiskers : band)(ink, curve, px, py, ratio); }
            if (curve.y) { (marks[series.mark] || marks.line)(ink, curve, px, py, ratio, series); }
          }
        }
      });
    }
  }

  function nearest(values, x) {
    if (!values.length) { return null; }
    let low = 0, high = values.length - 1;
    while (1 < high - low) { const middle = (low + high) >> 1; if (values[middle] <= x) { low = middle; } else { high = middle; } }
    return Math.abs(values[low] - x) <= Math.abs(values[high] - x) ? low : high;
  }

  const rgb = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
  const mix = ([from, to], share) => 'rgb(' + from.map((value, k) => Math.round(value + (to[k] - value) * share)).join(',') + ')';

  function level(ink, y, bbox) {
    ink.beginPath(); ink.moveTo(bbox.left, y); ink.lineTo(bbox.left + bbox.width, y); ink.stroke();
  }

  function path(ink, curve, px, py) {
    let down = false;
    ink.beginPath();
    for (let k = 0; k < curve.x.length; k++) {
      if (curve.x[k] === null || curve.y[k] === null) { down = false; continue; }
      const x = px(curve.x[k]), y = py(curve.y[k]);
      if (!isFinite(y)) { down = false; continue; }
      if (down) { ink.lineTo(x, y); } else { ink.moveTo(x, y); }
      down = true;
    }
    ink.stroke();
  }

  function each(curve, px, py, act) {
    for (let k = 0; k < curve.x.length; k++) {
      if (curve.x[k] !== null && curve.y[k] !== null) { act(px(curve.x[k]), py(curve.y[k])); }
    }
  }

  const dot = (radius, fill) => (ink, curve, px, py, ratio) => each(curve, px, py, (x, y) => {
    ink.beginPath(); ink.arc(x, y, radius * ratio, 0, 7);
    if (fill) { ink.fill(); } else { ink.stroke(); }
  });

  const marks = {
    line: path, dashed: path,
    marked(ink, curve, px, py, ratio) { path(ink, curve, px, py); dot(4, true)(ink, curve, px, py, ratio); },
    dots: dot(4, true), rings: dot(4, false),
    crosses(ink, curve, px, py, ratio) {
      const half = 4.5 * ratio;
      each(curve, px, py, (x, y) => {
        ink.beginPath(); ink.moveTo(x - half, y - half); ink.lineTo(x + half, y + half); ink.moveTo(x - half, y + half); ink.lineTo(x + half, y - half); ink.stroke();
      });
    },
    steps(ink, curve, px, py) {
      ink.beginPath();
      curve.x.forEach((at, k) => {
        const x = px(at), y = py(curve.y[k]);
        if (k === 0) { ink.moveTo(x, y); } else { ink.lineTo(x, py(curve.y[k - 1])); ink.lineTo(x, y); }
      });
      ink.stroke();
    },
  };

  function band(ink, curve, px, py) {
    const alpha = ink.globalAlpha, known = curve.x.map((_, k) => k).filter((k) => curve.low[k] !== null && curve.high[k] !== null);
    if (!known.length) { return; }
    ink.globalAlpha = 0.2;
    ink.beginPath();
    known.forEach((k, n) => { const x = px(curve.x[k]), y = py(curve.high[k]); if (n) { ink.lineTo(x, y); } else { ink.moveTo(x, y); } });
    known.reverse().forEach((k) => ink.lineTo(px(curve.x[k]), py(curve.low[k])));
    ink.closePath(); ink.fill();
    ink.globalAlpha = alpha;
  }

  function whiskers(ink, curve, px, py, ratio) {
    const cap = 5 * ratio;
    curve.x.forEach((at, k) => {
      if (curve.low[k] === null || curve.high[k] === null) { return; }
      const x = px(at), low = py(curve.low[k]), high = py(curve.high[k]);
      ink.beginPath(); ink.moveTo(x, low); ink.lineTo(x, high);
      for (const y of [low, high]) { ink.moveTo(x - cap, y); ink.lineTo(x + cap, y); }
      ink.stroke();
    });
  }

  // ---- All charts: made when they have a width, so those in closed details wait.

  const made = new Map();
  const watch = new ResizeObserver((entries) => requestAnimationFrame(() => {
    for (const { target } of entries) {
      if (target.getBoundingClientRect().width < 50) { continue; }
      const figure = target.parentElement;
      if (made.has(figure)) { made.get(figure).resize(); } else { made.set(figure, new Chart(figure)); }
    }
  }));
  for (const figure of document.querySelectorAll('figure.chart')) { watch.observe(figure.querySelector('.plot')); }
  matchMedia('(prefers-color-scheme:dark)').addEventListener('change', () => {
    colours = {};
    for (const chart of made.values()) { chart.plot.redraw(false, true); }
  });
})();
