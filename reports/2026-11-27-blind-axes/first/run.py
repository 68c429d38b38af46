import json,subprocess,time,os,sys
K=os.environ['KLASKTRON']; W='.'; END=float(sys.argv[1]) if len(sys.argv)>1 else 1e18
cases=json.load(open(W+'/cases.json')); by={c['name']:c for c in cases}
order=[]; mk=[]
for c in cases:
    if c['machine'] not in mk: mk.append(c['machine'])
groups={m:[c['name'] for c in cases if c['machine']==m and not c['single']] for m in mk}
for r in range(9):
    for m in mk:
        if r==0: order.append(m+'_base')
        if len(groups[m])>r: order.append(groups[m][r])
os.makedirs(W+'/mcap',exist_ok=True); os.makedirs(W+'/out',exist_ok=True); os.makedirs(W+'/log',exist_ok=True)
RES=W+'/results.json'; res=json.load(open(RES)) if os.path.exists(RES) else {}
MEX={'VC':[],'SV':['--supply-v','7.4'],'TT':['--counts-per-turn','262144'],'DC':['--velocity','velocity:rad/s']}
for n in order:
    if n in res: continue
    if time.time()>END: break
    c=by[n]; rec=[]; imp=[]
    for i,f in enumerate(c['files']):
        o=f'{W}/mcap/{n}-{i+1}.mcap'
        iu=c['input_unit']
        cmd=[K,'import','csv',f,'--time','t_s','--input','input:'+iu,'--position','position:'+c['position_unit'],'--overwrite','-o',o]+MEX.get(c['machine'],[])
        r=subprocess.run(cmd,capture_output=True,text=True); imp.append([r.returncode,r.stdout[-600:],r.stderr[-600:]]); rec.append(o)
    out=f'{W}/out/{n}'
    cmd=[K,'gap',*rec,'-o',out,'--threads','1','--overwrite']
    if not c['single']:
        tw=f"{W}/out/{c['machine']}_base/twin.json"
        cmd+=['--twin',tw]
    t=time.time(); 
    try:
        r=subprocess.run(cmd,capture_output=True,text=True,timeout=300); rc,so,se=r.returncode,r.stdout,r.stderr
    except subprocess.TimeoutExpired as e: rc,so,se='timeout',(e.stdout or b'').decode(),(e.stderr or b'').decode()
    d=time.time()-t
    open(f'{W}/log/{n}.txt','w').write(so+'\n---stderr---\n'+se)
    x=dict(status=rc,seconds=round(d,1),import_=imp)
    try:
        g=json.load(open(out+'/gap.json')) if rc!='timeout' else {}
        x.update(verdict=g['verdict'],summary=g['summary'],effects=[dict(name=e.get('effect',e.get('name')),parameters=e['parameters']) for e in g['effects']],changes=g.get('parameter_changes'),residuals=g.get('residuals'),indist=g.get('indistinguishable'),description=g.get('description'),warnings=g.get('warnings'))
    except Exception as e: x['error']=repr(e)
    res[n]=x; json.dump(res,open(RES,'w'),indent=1)
    print(time.strftime('%H:%M:%S'),n,rc,round(d,1),x.get('verdict'),[e['name'] for e in x.get('effects',[])],x.get('error',''),flush=True)
