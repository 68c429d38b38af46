#!/usr/bin/env python3
"""Independent simulator of single axes. Usage:
  axes.py list | gen NAME... | run NAME... (generate, import, gap) | show NAME... | count (all that were run, but x_*)
Each case goes to independent-axes/cases/NAME in the working folder: truth.json (written first), s1.csv.., s1.mcap.., gap/.
KLASKTRON is the program."""
import sys, os, json, ctypes, subprocess, time, hashlib, resource
import numpy as np
HERE = os.path.dirname(os.path.abspath(__file__)); ROOT = 'independent-axes'; PROGRAM = os.environ.get('KLASKTRON', 'klasktron')
os.makedirs(ROOT, exist_ok=True)
PN = ('M Fc Fv off G Gb noise mode Kp_p Kp_v Ki Mff vfilt ulim vKp vKi '
      'delay lag dbu0 dbs clip tsF tsv0 slew sagk sagT Fq asv asc Fs vs sdel dF dd Kl '
      'fps fpc fpA fpB fpL thc thv thT ripA ripB ripP grav m1 m2 kq k3 esk eslo eshi '
      'pay payhi paylo tmpk tmptau tmpr dist distf cur0 tmk tmc tml edb edv ksat drift dwk dwt').split()
SRC = r'''
#include <math.h>
#include <stdlib.h>
#include <string.h>
%s
static unsigned long long s; static double rnd(){s^=s<<13;s^=s>>7;s^=s<<17;return (s>>11)*(1.0/9007199254740992.0);}
static double gauss(){double r=0;for(int i=0;i<12;i++)r+=rnd();return r-6;}
static double sg(double x){return (x>0)-(x<0);}
/* ref: 3 columns (x,v,a) or (u,0,0) at control rate; out: 7 columns at record rate */
void sim(const double*p,double dt,int nc,int nr,long n,const double*ref,double x0,double lsb,unsigned long long seed,double*out){
 s=seed*2654435761ULL+88172645463325252ULL; for(int i=0;i<20;i++)rnd();
 double q=x0,v=0,u=0,I=0,vf=0,qmp=floor(x0/lsb+.5)*lsb,z=0,ul=0,r=0,Iv=0,Ps=0,temp=0,nf=0; int loaded=0;
 long nd=(long)(p[delay]/dt+.5); double*buf=calloc(nd+1,8); long ib=0; double tc=nc*dt;
 double ql=x0,vl=0,rest=0,brk=0; long ic=0, io=0;
 for(long i=0;i<n;i++){ double t=i*dt;
  if(i%%nc==0){ const double*R=ref+3*ic++;
   if(p[mode]==0) u=R[0];
   else if(p[mode]==1){ double qm=floor(q/lsb+.5)*lsb; double vd=(qm-qmp)/tc; qmp=qm; vf+=(vd-vf)*(1-exp(-tc/p[vfilt]));
     double e=R[1]+p[Kp_p]*(R[0]-qm)-vf; double F=p[Mff]*R[2]+p[Kp_v]*e+I; double un=F/p[G]+p[Gb]/p[G]*R[1]*(p[Mff]>0);
     if(un>p[ulim])un=p[ulim]; else if(un<-p[ulim])un=-p[ulim]; else I+=p[Ki]*e*tc; u=un; }
   else u=R[0];
   nf=gauss(); }
  buf[ib]=u; ib=(ib+1)%%(nd+1); double ud=buf[ib];   /* delayed by nd steps */
  double u1=ud;
  if(p[dbu0]>0){ if(fabs(u1)<p[dbu0])u1=0; else u1-=p[dbs]*p[dbu0]*sg(u1);}
  if(p[clip]>0){ if(u1>p[clip])u1=p[clip]; if(u1<-p[clip])u1=-p[clip]; }
  if(p[ksat]>0) u1=u1/(1+fabs(u1)/p[ksat]);
  if(p[lag]>0){ ul+=(u1-ul)*(1-exp(-dt/p[lag])); u1=ul; }
  double F;
  if(p[mode]==2){ if(p[slew]>0){ double d=u1-r,m=p[slew]*dt; if(d>m)d=m; if(d<-m)d=-m; r+=d;} else r=u1;
    double e=r-v; Iv+=p[vKi]*e*dt; F=p[vKp]*e+Iv; u1=r; }
  else F=p[G]*u1-p[Gb]*v;
  double Fd=F;
  if(p[tsF]>0){ double L=p[tsF]*(F*v>0?1-fabs(v)/p[tsv0]:1); if(L<0)L=0; if(F>L)F=L; if(F<-L)F=-L; }
  if(p[sagk]>0){ double P=F*v>0?F*v:0; if(p[sagT]>0)Ps+=(P-Ps)*dt/p[sagT]; else Ps=P; F*=1-p[sagk]*Ps; }
  double Flim=F-Fd;
  F+=p[noise]*nf;
  double fe=0;
  if(p[ripP]>0) fe+=p[ripA]*sin(2*M_PI*q/p[ripP])+p[ripB]*cos(2*M_PI*q/p[ripP]);
  fe+=-p[grav]*sin(q)-p[kq]*q-p[k3]*q*q*q;
  if(p[esk]>0){ if(q>p[eshi])fe-=p[esk]*(q-p[eshi]); if(q<p[eslo])fe-=p[esk]*(q-p[eslo]); }
  if(p[dist]>0) fe+=p[dist]*sin(2*M_PI*p[distf]*t+1.0);
  if(p[pay]>0){ if(q>p[payhi])loaded=1; if(q<p[paylo])loaded=0; }
  if(p[tml]>0){ double ft=p[tmk]*(q-ql)+p[tmc]*(v-vl); fe-=ft; vl+=dt*ft/p[tml]; ql+=vl*dt; }
  if(p[edb]>0) fe-=p[edb]*v/(1+v*v/(p[edv]*p[edv]));
  fe+=p[drift]*t;
  double av=fabs(v), sv=sg(v), fr=0; /* fr: extra friction level */
  fr+=p[Fq]*v*v+p[Kl]*fabs(F);
  fr+=.5*(p[asv]*v+p[asc]*sv);
  if(p[Fs]>0) fr+=p[Fs]*exp(-pow(av/p[vs],p[sdel]));
  fr+=p[fps]*q+p[fpc]*q*q; if(p[fpL]>0) fr+=p[fpA]*sin(2*M_PI*q/p[fpL])+p[fpB]*cos(2*M_PI*q/p[fpL]);
  if(p[thT]>0) fr+=(p[thc]+p[thv]*av)*(1-exp(-t/p[thT]));
  if(p[dwk]>0){ if(v==0){rest+=dt; brk=p[dwk]*(1-exp(-rest/p[dwt]));} else {rest=0; brk-=dt*fabs(v)/2e-3*brk; if(brk<0)brk=0;} fr+=brk; }
  if(p[tmptau]>0){ temp+=dt*(p[tmpr]*p[Fc]*av-temp)/p[tmptau]; fr+=p[tmpk]*temp; }
  double lev=p[Fc]+fr; if(lev<0)lev=0;
  double dahl=0; if(p[dF]>0){ double h=av/p[dd]; double zz=z; z=(z+dt*v/p[dd])/(1+dt*h); dahl=-p[dF]*.5*(z+zz); }
  double me=p[m1]*q+p[m2]*q*q+(loaded?p[pay]:0), m=p[M]+me;
  double cor=-.5*(p[m1]+2*p[m2]*q)*v*v;
  double f0=F+p[off]+fe+dahl+cor;
  double vn=(v+dt*f0/m)/(1+dt*p[Fv]/m); double dec=dt*lev/m;
  if(vn>dec)vn-=dec; else if(vn<-dec)vn+=dec; else vn=0;
  double a=(vn-v)/dt; 
  if(i%%nr==0 && i>0){ double*o=out+7*io++; o[0]=t; o[1]=q; o[2]=u; o[3]=F; o[4]=v; o[5]=a;
    o[6]=fe+cor+dahl-fr*sg(vn)-me*a+Flim+(p[mode]!=2?p[G]*(u1-u):p[vKp]*(u1-u)); }
  v=vn; q+=v*dt; }
 free(buf);
}
''' % '\n'.join(f'enum{{{n}={i}}};' for i, n in enumerate(PN))

_lib = None
def lib():
    global _lib
    if _lib is None:
        so = f'{ROOT}/sim_{hashlib.md5(SRC.encode()).hexdigest()[:8]}.so'
        if not os.path.exists(so):
            open(f'{ROOT}/sim.c', 'w').write(SRC)
            subprocess.check_call(['gcc', '-O2', '-shared', '-fPIC', f'{ROOT}/sim.c', '-o', so, '-lm'])
        _lib = ctypes.CDLL(so)
    return _lib

# ---- excitations at the control rate: arrays (n, 3)
def xva(x, fc):
    v = np.gradient(x, 1/fc); return np.c_[x, v, np.gradient(v, 1/fc)]
def multisine(T, fc, f0, f1, nf, amp, seed):
    rng = np.random.default_rng(seed); t = np.arange(int(T*fc)+2)/fc
    fs = np.geomspace(f0, f1, nf)*(1+.02*rng.standard_normal(nf))
    x = sum(np.sin(2*np.pi*f*t+rng.uniform(0, 6.28)) for f in fs); return amp*x/np.sqrt(nf/2)
def prbs(T, fc, hold, amp, seed, levels=(-1, 1)):
    rng = np.random.default_rng(seed); n = int(T*fc)+2; k = int(hold*fc)
    return amp*np.repeat(rng.choice(levels, n//k+1), k)[:n]
def scurve(T, fc, vmax, amax, tj, lo, hi, seed, dwell=.3, vvar=(.3, 1), shuttle=False):
    rng = np.random.default_rng(seed); x = (lo+hi)/2; vs = []; n = int(T*fc)+2; m = 0; k = 0
    while m < n:
        tgt = ((hi if k % 2 else lo) if shuttle else rng.uniform(lo, hi)); k += 1
        d = tgt-x; vm = vmax*rng.uniform(*vvar)
        if abs(d) < (hi-lo)*.1: continue
        vm = min(vm, np.sqrt(abs(d)*amax)); ta = vm/amax; tv = abs(d)/vm-ta
        na, nv = max(int(ta*fc), 1), max(int(tv*fc), 0)
        p = np.r_[np.linspace(0, vm, na), np.full(nv, vm), np.linspace(vm, 0, na)]; s = d/(p.sum()/fc)
        vs.append(p*s); vs.append(np.zeros(int((rng.uniform(.3, 1)*dwell+tj)*fc))); m += len(vs[-1])+len(p); x = tgt
    v = np.concatenate(vs)[:n]; j = max(int(tj*fc), 1)
    v = np.convolve(np.r_[np.zeros(j), v], np.ones(j)/j)[j:j+n]
    x = (lo+hi)/2+np.cumsum(v)/fc; return np.c_[x, v, np.gradient(v, 1/fc)]
def chirp(T, fc, f0, f1, amp, f_pow=1.0):
    t = np.arange(int(T*fc)+2)/fc; k = np.log(f1/f0)/T
    ph = 2*np.pi*f0*(np.exp(k*t)-1)/k; f = f0*np.exp(k*t); return amp*np.sin(ph)*(f0/f)**f_pow
def steps(T, fc, amp, hold, seed):
    rng = np.random.default_rng(seed); n = int(T*fc)+2; x = []; 
    while len(x) < n: x += [rng.uniform(-amp, amp)]*int(hold*rng.uniform(.6, 1.4)*fc)
    return np.array(x[:n])
def col(u): return np.c_[u, 0*u, 0*u]

CASES = {}
def case(name, machine, p, refs, fs, fc, iu, pu, lsb, unoise, measured, effects, ctl=None, note=''):
    """iu: (unit, u_SI per unit); pu: (unit, SI per unit); unoise: RMS noise on recorded input (SI of u);
    measured: recorded input is the actual force (in u units) else the command. effects: {name: {param: true in recorded units}}"""
    CASES[name] = dict(machine=machine, p=p, refs=refs, fs=fs, fc=fc, iu=iu, pu=pu, lsb=lsb, unoise=unoise,
                       measured=measured, effects=effects, note=note)

def simulate(c, k):
    p = dict(G=1.0, mode=1, vfilt=1e-3, ulim=1e9); p.update(c['p']); P = np.array([float(p.get(n, 0)) for n in PN])
    ref = np.ascontiguousarray(c['refs'][k](), float); fc, fs = c['fc'], c['fs']
    nc = int(np.ceil(40000/fc)); dt = 1/(fc*nc); nr = int(round(1/(fs*dt))); n = (len(ref)-1)*nc
    out = np.zeros((n//nr+1, 7)); D = ctypes.POINTER(ctypes.c_double)
    x0 = ref[0, 0] if p['mode'] == 1 else p.get('cur0', 0)
    lib().sim(P.ctypes.data_as(D), ctypes.c_double(dt), nc, nr, ctypes.c_long(n), ref.ctypes.data_as(D), ctypes.c_double(x0),
              ctypes.c_double(c['lsb']), ctypes.c_ulonglong(k+11), out.ctypes.data_as(D))
    o = out[:(n-1)//nr]; rng = np.random.default_rng(k+77)
    if not np.isfinite(o).all(): raise SystemExit('diverged')
    q = np.floor(o[:, 1]/c['lsb']+.5)*c['lsb']; u = (o[:, 3]+p.get('Gb', 0)*o[:, 4])/p['G'] if c['measured'] else o[:, 2]
    if c.get('avgu'): u = np.r_[u[0], (u[1:]+u[:-1])/2]  # recorded input delayed by half a sample: cancels the hold
    u = u+c['unoise']*rng.standard_normal(len(u))
    # visible part of the effect: least squares on base regressors while moving
    mv = np.abs(o[:, 4]) > .02*np.abs(o[:, 4]).max(); X = np.c_[o[:, 5], o[:, 4], np.sign(o[:, 4]), 1+0*o[:, 4]][mv]; e = o[mv, 6]
    g = p['vKp'] if p['mode'] == 2 else p['G']
    vis = np.sqrt(np.mean((e-X@np.linalg.lstsq(X, e, rcond=None)[0])**2))/g
    return o, q, u, dict(rms_effect=float(np.sqrt(np.mean(e**2))/g), visible=float(vis), rms_u=float(u.std()), moving=float(mv.mean()),
                         vmax=float(np.abs(o[:, 4]).max()), range=float(np.ptp(q)), pnoise=float(p.get('noise', 0)/g))

exec(open(f'{HERE}/cases.py').read())

def gen(name):
    c = CASES[name]; d = f'{ROOT}/cases/{name}'; os.makedirs(d, exist_ok=True)
    sims = [simulate(c, k) for k in range(len(c['refs']))]
    nz = np.hypot(c['unoise'], sims[0][3]['pnoise']); p = c['p']
    s = c['pu'][1]; g = c['iu'][1]  # SI per unit
    truth = dict(case=name, machine=c['machine'], effects=c['effects'], note=c['note'], fs=c['fs'], input_unit=c['iu'][0],
                 position_unit=c['pu'][0], measured=c['measured'], physics_si=p, encoder_lsb_si=c['lsb'],
                 noise_rms_input_si=nz, sessions=[x[3] for x in sims],
                 visible_over_noise=[x[3]['visible']/nz for x in sims], rms_effect_over_noise=[x[3]['rms_effect']/nz for x in sims])
    json.dump(truth, open(f'{d}/truth.json', 'w'), indent=1, default=float)
    for k, (o, q, u, _) in enumerate(sims):
        t = o[:, 0]-o[0, 0]
        np.savetxt(f'{d}/s{k+1}.csv', np.c_[t, u/g, q/s], delimiter=',', header='t,u,x', comments='', fmt=['%.6f', '%.7g', '%.9g'])
    print(f"{name:14s} fs {c['fs']} T {[round(len(x[0])/c['fs'],1) for x in sims]} vis/noise {[round(v,1) for v in truth['visible_over_noise']]}"
          f" rms/noise {[round(v,1) for v in truth['rms_effect_over_noise']]} u_rms {sims[0][3]['rms_u']:.3g} nz {nz:.3g} vmax {sims[0][3]['vmax']:.3g} rng {sims[0][3]['range']:.3g} mov {sims[0][3]['moving']:.2f}", flush=True)
    return d

def run(name, extra=(), tag='gap'):
    c = CASES[name]; d = gen(name); m = []
    for k in range(len(c['refs'])):
        m.append(f'{d}/s{k+1}.mcap')
        r = subprocess.run([PROGRAM, 'import', 'csv', f'{d}/s{k+1}.csv', '--time', 't:s', '--input', f"u:{c['iu'][0]}", '--position', f"x:{c['pu'][0]}",
                            '-o', m[-1], '--overwrite', '--session', f's{k+1}'], capture_output=True, text=True)
        if r.returncode: print(r.stdout, r.stderr)
    env = dict(os.environ, RAYON_NUM_THREADS='1'); t0 = time.time(); r0 = resource.getrusage(resource.RUSAGE_CHILDREN)
    r = subprocess.run(['nice', '-n', '5', PROGRAM, '-q', 'gap', *m, '-o', f'{d}/{tag}', '--overwrite', *extra], capture_output=True, text=True, env=env)
    r1 = resource.getrusage(resource.RUSAGE_CHILDREN); cpu = r1.ru_utime-r0.ru_utime+r1.ru_stime-r0.ru_stime
    open(f'{d}/{tag}.out', 'w').write(f'{r.stdout}\n--stderr\n{r.stderr}\nrc {r.returncode} cpu {cpu:.0f} wall {time.time()-t0:.0f}\n')
    print(f'  {name} rc {r.returncode} cpu {cpu:.0f}s wall {time.time()-t0:.0f}s', flush=True)
    show(name, tag)

def show(name, tag='gap'):
    d = f'{ROOT}/cases/{name}'
    try: g = json.load(open(f'{d}/{tag}/gap.json'))
    except Exception as e: print('  ', e, open(f'{d}/{tag}.out').read()[-600:]); return
    print('  ', g['verdict'], '|', g['summary'])
    for e in g['effects']:
        print('    +', e.get('name') or e.get('effect'), json.dumps(e.get('parameters'))[:700])
    for i in g.get('indistinguishable') or []: print('    ~', json.dumps(i)[:300])
    for w in g.get('warnings') or []: print('    !', str(w)[:300])
    print(flush=True)

def count():
    """Cases by kind of truth: a name although nothing is hidden, exactly the hidden effects, a wrong name."""
    kinds = {}
    for name in sorted(os.listdir(f'{ROOT}/cases')):
        d = f'{ROOT}/cases/{name}'
        if name.startswith('x_') or not os.path.exists(f'{d}/gap/gap.json'): continue
        truth = json.load(open(f'{d}/truth.json')); g = json.load(open(f'{d}/gap/gap.json'))
        hidden = list(truth['effects']); named = {e['name'] for e in g['effects']}
        hit = {h for h in hidden if named & set(h.split('|'))}
        wrong = {n for n in named if not any(n in h.split('|') for h in hidden)}
        setpoint = truth['physics_si'].get('mode') == 2
        kind = ('outside the catalogue' if 'UNKNOWN' in hidden else 'hidden effects' if hidden
                else 'none, velocity setpoint' if setpoint else 'none, force, torque, current or voltage')
        c = kinds.setdefault(kind, dict(cases=0, named=0, verdict_none=0, exact=0, with_wrong_name=0)); c['cases'] += 1
        c['named'] += bool(named); c['verdict_none'] += g['verdict'] == 'none'
        c['exact'] += bool(hidden) and len(hit) == len(hidden) and not wrong; c['with_wrong_name'] += bool(wrong)
    for kind, c in kinds.items(): print(kind, json.dumps(c))

if __name__ == '__main__':
    a = sys.argv[1:]
    if a[0] == 'list': print('\n'.join(CASES))
    elif a[0] == 'gen': [gen(n) for n in (a[1:] or CASES)]
    elif a[0] == 'run':
        ex = a[a.index('--')+1:] if '--' in a else []; ns = a[1:a.index('--')] if '--' in a else a[1:]
        tag = 'gap'
        if ns and ns[0].startswith('tag='): tag = ns.pop(0)[4:]
        for n in (ns or CASES): run(n, ex, tag)
    elif a[0] == 'count': count()
    elif a[0] == 'show': [show(n) for n in (a[1:] or CASES)]
