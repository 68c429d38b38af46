/* Independent simulator of a CoreXY gantry with drives, belts, LuGre guides, and a magnet-dragged striker. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "params.h"
#define BELT 0.04
static const double RP = BELT/(2*M_PI);
typedef struct {double z;} Br;
static inline double lugre(Br*b,double v,double fc,double fs,double vs,double z0,double m,double dt){
  /* bristle with exact relaxation for large |v| */
  if(fc<=0) return 0;
  double s0=fc/z0, g=fc+(fs-fc)*exp(-(v/vs)*(v/vs));
  double r=fabs(v)*s0/g; /* 1/s */
  double zss = (v>0?1:(v<0?-1:0))*g/s0;
  double zn = r*dt>1e-9 ? zss+(b->z-zss)*exp(-r*dt) : b->z+v*dt;
  double zd=(zn-b->z)/dt; b->z=zn;
  double s1=0.4*sqrt(s0*m);
  return s0*zn+s1*zd;
}
#define NQ 4096
/* cmd: nc send times tc, refs; arrival aa,ab after send. outputs cmdx,cmdy. enc: ta[],tb[] sample times; outputs qa,va,tta,tea .. ; cam tcams -> sx,sy ; carriage truth */
int sim(const double*p,double T,double x0,double y0,
  int nc,const double*tc,const double*rx,const double*ry,const double*rvx,const double*rvy,double arra,double arrb,double*cx,double*cy,
  int ne,const double*te_a,const double*te_b,double*ea,double*eb, /* 4 columns: pos, vel, ttarget, test */
  int nk,const double*tk,double*cam /* 4: striker x y, carriage x y */, double*stat)
{
  const double dt=1.0/32000; const int sub=4;
  double x=x0,y=y0,vx=0,vy=0, q[2]={x0+y0,x0-y0},v[2]={0,0};
  double sx=x0,sy=y0,svx=0,svy=0; double zs[2]={0,0};
  Br bx={0},by={0},bm[2]={{0},{0}};
  double pllp[2]={q[0],q[1]},pllv[2]={0,0},integ[2]={0,0},cur[2]={0,0},tgt[2]={0,0};
  double sp[2]={0,0},spl[2]={0,0},spr[2]={0,0};
  static double qt[2][NQ],qv[2][NQ]; int qh[2]={0,0},qn[2]={0,0};
  int ic=0,ia=0,ib=0,ik=0; double lastx=x0,lasty=y0; double P=0;
  double e_prev[2]={0,0};
  const double mrot[2]={p[P_mrot_a],p[P_mrot_b]},kb[2]={p[P_kb_a],p[P_kb_b]},cb[2]={p[P_cb_a],p[P_cb_b]},gp[2]={p[P_gap_a],p[P_gap_b]};
  const double fm[2]={p[P_fma],p[P_fmb]},fvm[2]={p[P_fva],p[P_fvb]},cog[2]={p[P_cog_a],p[P_cog_b]},cogN[2]={p[P_cogN_a],p[P_cogN_b]},cogph[2]={p[P_cogph_a],p[P_cogph_b]};
  const double kp[2]={p[P_kp_a],p[P_kp_b]},ki[2]={p[P_ki_a],p[P_ki_b]},tl[2]={p[P_tlim_a],p[P_tlim_b]},gain[2]={p[P_gain_a],p[P_gain_b]},off[2]={p[P_off_a],p[P_off_b]},dly[2]={p[P_delay_a],p[P_delay_b]};
  const double ecc[2]={p[P_ecc_a],p[P_ecc_b]};
  double maxd=0,maxv=0,maxF=0,xmin=9,xmax=-9,ymin=9,ymax=-9,maxa=0; double vpx=0,vpy=0;
  long n=(long)(T/dt);
  double enc[2];
  for(long i=0;i<n;i++){
    double t=i*dt;
    if(i%sub==0){
      double h=dt*sub;
      /* host */
      while(ic<nc && tc[ic]<=t){
        double ux=rvx[ic]+p[P_hostkp]*(rx[ic]-lastx), uy=rvy[ic]+p[P_hostkp]*(ry[ic]-lasty);
        double m=p[P_hostvmax]; if(ux>m)ux=m; if(ux<-m)ux=-m; if(uy>m)uy=m; if(uy<-m)uy=-m;
        ux=(float)ux; uy=(float)uy; cx[ic]=ux; cy[ic]=uy;
        double s[2]={ux+uy,ux-uy}, ar[2]={arra,arrb};
        for(int k=0;k<2;k++){int w=(qh[k]+qn[k])%NQ; qt[k][w]=tc[ic]+ar[k]+dly[k]; qv[k][w]=s[k]; qn[k]++;}
        ic++;
      }
      for(int k=0;k<2;k++){
        while(qn[k]>0 && qt[k][qh[k]]<=t){sp[k]=qv[k][qh[k]]; qh[k]=(qh[k]+1)%NQ; qn[k]--;}
        double u=sp[k]*gain[k]+off[k];
        if(fabs(u)<p[P_dead]) u=0;
        if(p[P_vmax]>0){ if(u>p[P_vmax])u=p[P_vmax]; if(u<-p[P_vmax])u=-p[P_vmax]; }
        if(p[P_lag]>0) spl[k]+=(u-spl[k])*(1-exp(-h/p[P_lag])); else spl[k]=u;
        double d=spl[k]-spr[k]; if(p[P_slew]>0){double mm=p[P_slew]*h; if(d>mm)d=mm; if(d<-mm)d=-mm;} spr[k]+=d;
        /* encoder + PLL (critically damped) */
        double qq=q[k]+ecc[k]*sin(2*M_PI*q[k]/BELT+p[P_eccph]);
        double st=p[P_encstep]; enc[k]=st*floor(qq/st);
        double bw=p[P_pll]; 
        pllp[k]+=h*pllv[k]; double dp=enc[k]-pllp[k]; pllp[k]+=h*2*bw*dp; pllv[k]+=h*bw*bw*dp;
        double e=spr[k]-pllv[k];
        double F=kp[k]*e+integ[k]; int lim=0;
        if(F>tl[k]){F=tl[k];lim=1;} if(F<-tl[k]){F=-tl[k];lim=1;}
        if(lim) integ[k]*=0.99; else integ[k]+=h*ki[k]*e;
        tgt[k]=F;
        cur[k]+=(F-cur[k])*(1-exp(-h/p[P_tau_cur]));
      }
      while(ia<ne && te_a[ia]<=t){ea[4*ia]=pllp[0];ea[4*ia+1]=pllv[0];ea[4*ia+2]=tgt[0]*RP;ea[4*ia+3]=cur[0]*RP;ia++;}
      while(ib<ne && te_b[ib]<=t){eb[4*ib]=pllp[1];eb[4*ib+1]=pllv[1];eb[4*ib+2]=tgt[1]*RP;eb[4*ib+3]=cur[1]*RP;ib++; lastx=(pllp[0]+pllp[1])/2; lasty=(pllp[0]-pllp[1])/2;}
    }
    while(ik<nk && tk[ik]<=t){double w=tk[ik]-t; cam[4*ik]=sx+svx*w;cam[4*ik+1]=sy+svy*w;cam[4*ik+2]=x;cam[4*ik+3]=y;ik++;}
    /* belts: load coordinate of a = x+y, of b = x-y */
    double L[2]={x+y,x-y},VL[2]={vx+vy,vx-vy},F[2];
    double sagf=1.0;
    if(p[P_sag]>0){double pw=0; for(int k=0;k<2;k++){double w=cur[k]*v[k]; if(w>0)pw+=w;} P+=(pw-P)*dt/p[P_sagT]; sagf=1-p[P_sag]*P; if(sagf<0)sagf=0;}
    for(int k=0;k<2;k++){
      double e=q[k]-L[k],de=v[k]-VL[k],g=gp[k]/2;
      double con=0; if(g<=0)con=e; else if(e>g)con=e-g; else if(e<-g)con=e+g;
      F[k]=kb[k]*con+((g<=0||con!=0)?cb[k]*de:0);
    }
    double amp=p[P_therm]; double tw=amp!=0?1+amp*(1-exp(-t/p[P_thermT])):1;
    double px=1+p[P_posfr]*sin(2*M_PI*x/p[P_posL]), py=1+p[P_posfr]*sin(2*M_PI*y/p[P_posL]+0.7);
    double ax1=tw*px*(1+p[P_asx]*(vx>0?1:-1)),ay1=tw*py*(1+p[P_asy]*(vy>0?1:-1));
    double lfx=p[P_loadfr]*fabs(F[0]+F[1]),lfy=p[P_loadfr]*fabs(F[0]-F[1]);
    double ffx=lugre(&bx,vx,p[P_fcx]*ax1+lfx,p[P_fsx]*ax1+lfx,p[P_vsx],p[P_z0x],p[P_mx],dt)+p[P_fvx]*tw*vx+p[P_fqx]*vx*fabs(vx);
    double ffy=lugre(&by,vy,p[P_fcy]*ay1+lfy,p[P_fsy]*ay1+lfy,p[P_vsy],p[P_z0y],p[P_my],dt)+p[P_fvy]*tw*vy+p[P_fqy]*vy*fabs(vy);
    /* striker */
    double dx=x-sx,dy=y-sy,dd=(dx*dx+dy*dy)/(p[P_d0]*p[P_d0]); double kk=p[P_km]/pow(1+dd,1.5);
    double Mx=kk*dx+p[P_cm]*(vx-svx),My=kk*dy+p[P_cm]*(vy-svy);
    double s0=p[P_fst]/p[P_z0s],sv=sqrt(svx*svx+svy*svy),r=sv/p[P_z0s];
    double al=exp(-r*dt),zx,zy; 
    if(r*dt>1e-9){zx=svx/sv*p[P_z0s]*(1-al)+zs[0]*al; zy=svy/sv*p[P_z0s]*(1-al)+zs[1]*al;} else {zx=zs[0]+svx*dt;zy=zs[1]+svy*dt;}
    double s1=0.5*sqrt(s0*p[P_ms]);
    double fsx=s0*zx+s1*(zx-zs[0])/dt,fsy=s0*zy+s1*(zy-zs[1])/dt; zs[0]=zx;zs[1]=zy;
    double sax=(Mx-fsx)/p[P_ms],say=(My-fsy)/p[P_ms];
    double fx=F[0]+F[1]-ffx+p[P_tiltx]-Mx, fy=F[0]-F[1]-ffy+p[P_tilty]-My;
    if(p[P_pushD]>0 && t>=p[P_pushT] && t<p[P_pushT]+p[P_pushD]){double s=sin(M_PI*(t-p[P_pushT])/p[P_pushD]); fx+=s*p[P_pushFx]; fy+=s*p[P_pushFy];}
    fx-=p[P_xcd]*vy; fy-=p[P_xcd]*vx;
    double m12=p[P_xcm],det=p[P_mx]*p[P_my]-m12*m12;
    double ax=(fx*p[P_my]-fy*m12)/det, ay=(fy*p[P_mx]-fx*m12)/det;
    for(int k=0;k<2;k++){
      double Fm=cur[k]*sagf + cog[k]*sin(2*M_PI*cogN[k]*q[k]/BELT+cogph[k]);
      double fr=lugre(&bm[k],v[k],fm[k],fm[k],0.01,p[P_z0m],mrot[k],dt)+fvm[k]*v[k];
      v[k]+=dt*(Fm-F[k]-fr)/mrot[k];
      if(fabs(cur[k])>maxF)maxF=fabs(cur[k]);
    }
    vx+=dt*ax; vy+=dt*ay; svx+=dt*sax; svy+=dt*say;
    for(int k=0;k<2;k++)q[k]+=dt*v[k];
    x+=dt*vx;y+=dt*vy;sx+=dt*svx;sy+=dt*svy;
    double d=sqrt((x-sx)*(x-sx)+(y-sy)*(y-sy)); if(d>maxd)maxd=d; if(fabs(v[0])>maxv)maxv=fabs(v[0]);
    if(x<xmin)xmin=x;if(x>xmax)xmax=x;if(y<ymin)ymin=y;if(y>ymax)ymax=y;
    if(!(fabs(x)<10))return 1;
  }
  stat[0]=maxd;stat[1]=maxv;stat[2]=maxF;stat[3]=xmin;stat[4]=xmax;stat[5]=ymin;stat[6]=ymax;
  return 0;
}
